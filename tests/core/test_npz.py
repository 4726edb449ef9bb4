"""Arrays of others: what a file declares is believed only where its bytes are there."""

import hashlib
import io
import sys
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of

from hlsd.core.errors import HlsdError
from hlsd.core.npy import Expected, parse_npy
from hlsd.core.npz import arrays_bytes, read_array, read_arrays, write_arrays

GOOD = "{'descr': '<f8', 'fortran_order': False, 'shape': (2,), }"


def npy(array) -> bytes:
    target = io.BytesIO()
    np.save(target, array)
    return target.getvalue()


def with_head(head: str, body: bytes = bytes(16), version: int = 1) -> bytes:
    size = len(head).to_bytes(2 if version == 1 else 4, "little")
    return b"\x93NUMPY" + bytes([version, 0]) + size + head.encode("latin-1") + body


def refusal(read, *args, **options) -> str:
    with pytest.raises(HlsdError) as caught:
        read(*args, **options)
    text = str(caught.value)
    assert text.isprintable()
    return text


DTYPES = st.one_of(
    arrays_of.boolean_dtypes(),
    arrays_of.integer_dtypes(endianness="?"),
    arrays_of.unsigned_integer_dtypes(endianness="?"),
    arrays_of.floating_dtypes(endianness="?", sizes=(16, 32, 64)),
)
SHAPES = arrays_of.array_shapes(min_dims=0, max_dims=3, min_side=0)
TEXTS = st.lists(st.text(st.characters(exclude_categories=["Cs"]), max_size=5))


@settings(max_examples=100, deadline=None)
@given(
    array=st.one_of(
        DTYPES.flatmap(lambda dtype: arrays_of.arrays(dtype, SHAPES)),
        TEXTS.map(lambda texts: np.array(texts, dtype=">U5")),
    ),
    order=st.sampled_from("CF"),
)
def test_arrays_come_back_as_numpy_reads_them(array, order):
    data = npy(np.asarray(array, order=order))
    expected = np.load(io.BytesIO(data))
    found = parse_npy(data)
    np.testing.assert_array_equal(found, expected)
    assert found.shape == expected.shape
    assert found.dtype == expected.dtype.newbyteorder("=")
    assert found.flags.writeable


@settings(max_examples=200, deadline=None)
@given(junk=st.binary(max_size=300), keep=st.integers(0, 12))
def test_junk_is_no_array(junk, keep):
    data = with_head(GOOD)[:keep] + junk
    try:
        found = parse_npy(data)
    except ValueError:
        return
    np.testing.assert_array_equal(found, np.load(io.BytesIO(data)))


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "empty"),
        (b"PK\x03\x04", "does not start"),
        (with_head(GOOD)[:30], "breaks off"),
        (with_head(GOOD)[:-1], "15 follow"),
        (with_head(GOOD) + b"\0", "17 follow"),
        (with_head(GOOD.replace("(2,)", "(12884901888,)")), "16 follow"),
        (with_head(GOOD.replace("(2,)", f"({'9' * 13},)")), "too large"),
        (with_head(GOOD.replace("(2,)", f"({'9' * 30},)")), "whole numbers"),
        (with_head(GOOD.replace("(2,)", "(-2,)")), "plain numbers"),
        (with_head(GOOD.replace("(2,)", "(2)")), "tuple"),
        (with_head(GOOD.replace("<f8", "|O")), "Python objects"),
        (with_head(GOOD.replace("<f8", "<c16")), "not plain numbers"),
        (with_head(GOOD.replace("<f8", "<M8[s]")), "plain numbers"),
        (with_head(GOOD.replace("'<f8'", "[('a', '<f8')]")), "plain numbers"),
        (with_head(GOOD.replace("'<f8'", "b'<f8'")), "plain numbers"),
        (with_head(GOOD.replace("<f8", "<U999999999")), "not plain numbers"),
        (with_head(GOOD.replace("<f8", "<U0").replace("2", "9"), b""), "empty texts"),
        (with_head("(" * 9000), "plain numbers"),
        (with_head("{'descr': '''", b""), "plain numbers"),
        (with_head(GOOD + " " * 20_000), "too long"),
        (with_head(GOOD, version=7), "version"),
        (npy(np.array(["ab"])).replace(b"a\0\0\0", b"\0\xd8\0\0"), "not a character"),
        (npy(np.array(["ab"])).replace(b"a\0\0\0", b"\xff" * 4), "not a character"),
        (npy(np.array([True])).replace(b"\n\1", b"\n\2"), "truth values"),
    ],
)
def test_a_head_that_lies_is_refused_before_anything_is_made(tmp_path, data, says):
    file = tmp_path / "a.npy"
    file.write_bytes(data)
    text = refusal(read_array, file, Expected(), "BARN grid")
    assert str(file) in text
    assert says in text


def put(tmp_path, members, kind=zipfile.ZIP_STORED):
    file = tmp_path / "a.npz"
    with zipfile.ZipFile(file, "w", kind) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return file


def read(file, most=2**20):
    return read_arrays(file, {"a": Expected(ndim=1)}, "log", "make one", most)


def test_what_is_written_is_read_as_expected(tmp_path):
    file = tmp_path / "a.npz"
    write_arrays(file, {"a": np.arange(3), "b": np.array("x")})
    assert read(file)["a"].tolist() == [0, 1, 2]
    assert read_arrays(file, ("a", "b"), "log", "make one")["b"].item() == "x"
    for wanted, says in [
        ({"a": Expected("U")}, "a has int64, needed are text"),
        ({"a": Expected(ndim=2)}, "a has shape (3,), needed are 2 dimensions"),
        ({"a": Expected(ndim=0)}, "a has shape (3,), needed is a single value"),
        ({"a": Expected(bits=32)}, "a has int64, needed are 32 bits"),
        ({"b": Expected()}, "b has <U1, needed are"),
        ({"c": Expected()}, "it lacks c"),
    ]:
        text = refusal(read_arrays, file, wanted, "log", "make one")
        assert says in text
        assert text.startswith(f"{file} is not a log (")
        assert text.endswith("): make one")


def test_the_bytes_are_the_same_in_every_version_of_python():
    """Python before 3.11.4 has other headers; numpy with later ones has these."""
    arrays = {
        "scan": np.arange(5.0),
        "weights": np.array([[0.5, -1.0]], dtype=np.float32),
        "name": np.array("hlsd10"),
        "file": np.array(7),
    }
    written = arrays_bytes(arrays)
    digest = hashlib.sha256(written).hexdigest()
    assert digest == "916610c414eb1fedc598823c3ada0add85981d143cc49b43bac0170825e6ec9a"
    with np.load(io.BytesIO(written)) as read:
        assert list(read) == list(arrays)
        for name, array in arrays.items():
            np.testing.assert_array_equal(read[name], array)
    if sys.version_info >= (3, 11, 4):
        arrays.pop("file")  # which numpy takes for its own
        numpys = io.BytesIO()
        np.savez(numpys, **arrays)
        assert arrays_bytes(arrays) == numpys.getvalue()


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_odd_archives_are_refused(tmp_path):
    good = ("a.npy", npy(np.zeros(3)))
    file = put(tmp_path, [good, good])
    assert "two members 'a.npy'" in refusal(read, file)
    file = put(tmp_path, [good], zipfile.ZIP_LZMA)
    assert "packed in an odd way" in refusal(read, file)
    data = bytearray(put(tmp_path, [good]).read_bytes())
    data[data.index(b"PK\x01\x02") + 8] |= 1
    file.write_bytes(data)
    assert "encrypted" in refusal(read, file)
    file.write_bytes(good[1])
    assert "a single array" in refusal(read, file)
    file = put(tmp_path, [(f"{k}", b"") for k in range(10_001)])
    assert "more than 10000 members" in refusal(read, file)


def test_an_archive_may_not_unpack_to_much_more_than_it_should(tmp_path):
    bomb = npy(np.zeros(2**20))
    file = put(tmp_path, [("a.npy", bomb)], zipfile.ZIP_DEFLATED)
    assert file.stat().st_size < 2**15
    assert "unpacks to more than 1048576 bytes" in refusal(read, file)
    # One that declares less than it unpacks to.
    data = bytearray(file.read_bytes())
    for head, at in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
        start = data.index(head) + at
        data[start : start + 4] = (1000).to_bytes(4, "little")
    file.write_bytes(data)
    assert "truncated or damaged" in refusal(read, file)


@pytest.mark.parametrize("keep", [0, 4, 30, 100, -30, -1])
def test_a_truncated_archive_is_refused(tmp_path, keep):
    file = put(tmp_path, [("a.npy", npy(np.zeros(3)))])
    file.write_bytes(file.read_bytes()[:keep])
    assert "truncated or damaged" in refusal(read, file)
