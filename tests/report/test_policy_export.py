"""`hlsd export-policy` as a user runs it: cards, files, errors."""

import hashlib
import json
import sys
import zipfile

import pytest
from typer.testing import CliRunner

import hlsd
from hlsd.cli.app import app
from hlsd.learning.policy import shipped_policy


def run(*arguments):
    return CliRunner().invoke(app, ["export-policy", *map(str, arguments)])


def refused(*arguments):
    told = run(*arguments)
    assert isinstance(told.exception, hlsd.HlsdError), told.output
    return str(told.exception)


@pytest.mark.parametrize("name", ["hlsd04", "hlsd10", "lfh04", "lfh10"])
def test_a_card_holds_what_the_policy_knows(name, tmp_path):
    text = run(name, "--card").output
    preset = "1.0" if name.endswith("10") else "0.4"
    sha256 = hashlib.sha256(shipped_policy(name).read_bytes()).hexdigest()
    for part in (f"`{name}`", f"| data: preset | {preset} |", sha256, "| MIT |"):
        assert part in text
    assert f"`hlsd bench --planner {name}`: " in text
    assert ("imagined around the global path" in text) == name.startswith("lfh")
    assert "(batch, 720)" in text
    # The same for programs.
    run(name, "--out", tmp_path / "card.json")
    card = json.loads((tmp_path / "card.json").read_text(encoding="utf-8"))
    assert card["sha256"] == sha256
    assert card["network"]["layers"] == [722, 256, 256, 256, 2]
    assert card["measured"][0]["runs"] == 900
    run(name, "--out", tmp_path / "card.md")
    assert (tmp_path / "card.md").read_text(encoding="utf-8") == text


def test_a_policy_of_ones_own_has_no_numbers_of_others(tmp_path):
    """What ships is known by its digest, not by the planner that a file names."""
    policy = hlsd.Policy.load(shipped_policy("hlsd10"))
    biases = (*policy.biases[:-1], policy.biases[-1] + 1)
    own = hlsd.Policy(policy.weights, biases, policy.clip_m, policy.provenance, 0.9)
    own.save(tmp_path / "own.npz")
    text = run(tmp_path / "own.npz", "--card").output
    assert "Nothing is recorded" in text
    assert "| licence | not recorded |" in text


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """Folder of a run of the shipped policy."""
    return drive(tmp_path_factory.mktemp("export") / "run", {})


def drive(out, policies):
    hlsd.bench(
        "hlsd10",
        worlds=[60],
        trials=1,
        jobs=1,
        policies=policies,
        out=out,
        progress=False,
    )
    return out


def test_a_card_tells_of_a_run_of_the_same_policy_alone(driven):
    text = run("hlsd10", "--card", "--run", driven).output
    (line,) = [each for each in text.splitlines() if "--trials 1" in each]
    assert "1 runs on barn300, 1 worlds" in line
    assert "--protocol hlsd2021 --robot jackal --seed 0" in line
    assert "no planner of" in refused("lfh10", "--card", "--run", driven)


def test_errors_are_one_line_and_write_nothing(tmp_path, monkeypatch):
    assert "nothing to do" in refused("hlsd10")
    assert "must end in" in refused("hlsd10", "--out", tmp_path / "x.pt")
    assert "no policy ships" in refused("dwa", "--card")
    assert "there is no policy" in refused(tmp_path / "none.npz", "--card")
    (tmp_path / "x.md").write_text("mine")
    assert "exists already" in refused("hlsd10", "--out", tmp_path / "x.md")
    for package in ("onnxruntime", "onnx"):
        monkeypatch.setitem(sys.modules, package, None)
        assert "hlsd[onnx]" in refused("hlsd10", "--out", tmp_path / "x.onnx")
    (tmp_path / "y.onnx").write_bytes(b"")
    assert "hlsd[onnx]" in refused(tmp_path / "y.onnx", "--card")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.md", "y.onnx"]


def test_onnx_out_and_in_drives_the_same_rows(driven, tmp_path):
    pytest.importorskip("onnx", reason="needs the extra onnx")
    onnxruntime = pytest.importorskip("onnxruntime", reason="needs the extra onnx")
    file = tmp_path / "p.onnx"
    told = run("hlsd10", "--out", file)
    assert "bound 0.0001" in told.output
    metadata = onnxruntime.InferenceSession(
        str(file), providers=["CPUExecutionProvider"]
    ).get_modelmeta()
    assert metadata.custom_metadata_map["hlsd.card"] == run("hlsd10", "--card").output
    run(file, "--out", tmp_path / "back.npz")
    assert (tmp_path / "back.npz").read_bytes() == shipped_policy("hlsd10").read_bytes()
    again = drive(tmp_path / "again", {"hlsd10": file})
    assert rows(again) == rows(driven)
    kept = []
    for folder in (again, driven):
        with zipfile.ZipFile(folder / "trajectories.zip") as archive:
            kept.append({name: archive.read(name) for name in archive.namelist()})
    assert kept[0] == kept[1] != {}


def rows(folder):
    """The cells of a run's table, without the time that computing took."""
    lines = (folder / "episodes.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].endswith(",wall_s")
    assert len(lines) == 2
    return [line.rpartition(",")[0] for line in lines]
