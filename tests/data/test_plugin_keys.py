"""Key frames out of compiled plug-ins: every one right, or one line that says why not.

The compiler is the reference: what stands in the source must be what is read.
"""

import builtins
import contextlib
import re
import struct

import numpy as np
import pytest

from hlsd.core.errors import HlsdError
from hlsd.data.plugin_keys import read_plugin
from tests.data.mover_plugins import compile_plugin, key_code, keys_code

pytest.importorskip("capstone", reason="needs the extra dynabarn")
pytest.importorskip("elftools", reason="needs the extra dynabarn")

KEYS = [
    (0.0, 10.0, -6.0),
    (6.29, 7.78, -3.78),
    (12.57, 0.0, 0.0),
    (16.24, -10.0, 0.01),
]


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"version": "v6"},
        {"by": "T "},
        {"head": "public: virtual ~Vector3() {}"},
        {"options": ("-O0", "-fcf-protection=full")},
        {"options": ("-O0", "-Wl,-z,now")},
        {"options": ("-O0", "-fno-plt")},
        {"options": ("-O0", "-fstack-protector-all")},
        {"options": ("-O0", "-mavx")},
        {"options": ("-O0", "-s")},
        {"options": ("-O0", "-fno-exceptions", "-fomit-frame-pointer")},
    ],
    ids=str,
)
def test_keys_are_those_of_the_source(tmp_path, how):
    file = compile_plugin(tmp_path / "a.so", keys_code(KEYS), "16.24", **how)
    assert read_plugin(file).keys.tolist() == [list(key) for key in KEYS]


def test_whole_numbers_and_negative_zero(tmp_path):
    body = key_code("0", "-10", "-0.00") + key_code("5", "1", "7")
    track = read_plugin(compile_plugin(tmp_path / "a.so", body, "5"))
    assert track.keys.tolist() == [[0, -10, 0], [5, 1, 7]]
    assert not np.signbit(track.keys[0, 2])


def test_a_number_that_is_converted_while_it_runs(tmp_path):
    body = key_code("0", "1", "2") + "int whole = -7;\n" + key_code("5", "whole", "7")
    track = read_plugin(compile_plugin(tmp_path / "a.so", body, "5"))
    assert track.keys.tolist() == [[0, 1, 2], [5, -7, 7]]


TWO = key_code("0", "1", "2") + key_code("5", "3", "4")


@pytest.mark.parametrize(
    ("body", "how", "said"),
    [
        ("", {}, "none of its functions Load"),
        (TWO, {"length": "6"}, "lasts 6.0 s and its last key is at 5.0 s"),
        (TWO, {"repeats": "false"}, "does not repeat"),
        (key_code("0", "1", "2", z="0.5"), {}, "lifts the obstacle to z = 0.5"),
        (key_code("0", "1", "2", turn="0.1, 0, 0"), {}, "tilts the obstacle"),
        (key_code("1", "1", "2"), {"length": "1"}, "do not ascend from 0"),
        (
            "double d = *(double *)model;\n" + key_code("0", "d", "2"),
            {"length": "0"},
            "x of key 0 is not a constant",
        ),
        ("anim->CreateKeyFrame(0);", {"length": "0"}, "x of key 0 is not a constant"),
        (
            f"for (int k = 0; k < 2; k++) {{ {TWO} }}",
            {},
            "in a loop, or not always",
        ),
        (f"if (model) {{ {TWO} }}", {}, "in a loop, or not always"),
        (
            TWO + 'common::PoseAnimationPtr b(new common::PoseAnimation("", 5, true));',
            {},
            "makes 2 animations",
        ),
    ],
)
def test_what_is_no_constant_track_is_refused(tmp_path, body, how, said):
    length = how.get("length", "5")
    rest = {name: value for name, value in how.items() if name != "length"}
    file = compile_plugin(tmp_path / "a.so", body, length, **rest)
    with pytest.raises(HlsdError, match=re.escape(said)) as error:
        read_plugin(file)
    assert "a.so is not a plug-in of constant key frames" in str(error.value)


def test_an_optimised_plugin_is_right_or_refused(tmp_path):
    file = compile_plugin(tmp_path / "a.so", keys_code(KEYS), "16.24", options=("-O2",))
    with contextlib.suppress(HlsdError):
        assert read_plugin(file).keys.tolist() == [list(key) for key in KEYS]


def test_other_files_are_refused(tmp_path):
    file = tmp_path / "a.so"
    with pytest.raises(HlsdError, match="there is no plug-in"):
        read_plugin(file)
    file.write_bytes(b"MZ and more")
    with pytest.raises(HlsdError, match="not an ELF file of 64 bits"):
        read_plugin(file)
    compile_plugin(file, TWO, "5")
    data = bytearray(file.read_bytes())
    file.write_bytes(data[: len(data) // 2])
    with pytest.raises(HlsdError, match="ends before its table"):
        read_plugin(file)
    data[18:20] = struct.pack("<H", 183)  # e_machine: AArch64
    file.write_bytes(data)
    with pytest.raises(HlsdError, match="for EM_AARCH64, not for x86-64"):
        read_plugin(file)


@pytest.mark.parametrize("absent", ["capstone", "elftools"])
def test_without_the_extra_it_says_what_to_install(tmp_path, monkeypatch, absent):
    found = builtins.__import__

    def without(name, *rest):
        if name.split(".")[0] == absent:
            raise ModuleNotFoundError(name)
        return found(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(HlsdError, match=re.escape("pip install 'hlsd[dynabarn]'")):
        read_plugin(tmp_path / "a.so")
