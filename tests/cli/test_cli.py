"""The command line as a user runs it: results, clear errors, exit codes."""

import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.cli.ready import ready
from tests.conftest import heed_signals

ROOT = Path(__file__).resolve().parents[2]
PLANNER = "examples.follow_path:FollowPath"
STAGES = (
    "bench",
    "planners",
    "collect",
    "train",
    "reproduce",
    "ablate",
    "validate",
    "import",
    "export",
    "merge",
    "report",
    "compare",
    "gate",
    "baseline",
    "worlds",
    "robots",
)


def hlsd(*arguments, cwd=ROOT, **environment):
    """A command without the time that imports take."""
    return ready(*arguments, cwd=cwd, **environment)


def started_anew(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "hlsd", *map(str, arguments)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.parametrize(
    "words", [("bench", "--planner"), ("bench", "--planner", "hlsd11")]
)
def test_a_command_that_is_ready_says_what_one_that_starts_does(words):
    """Most tests trust `tests.cli.ready`."""
    anew, here = started_anew(*words), hlsd(*words)
    assert (here.returncode, here.stdout, here.stderr) == (
        *(anew.returncode, anew.stdout, anew.stderr),
    )


def assert_refused(result, *fragments):
    """One line on stderr that says all of this, nothing on stdout, exit code 2."""
    assert result.returncode == 2, result.stderr
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    for fragment in fragments:
        assert fragment in lines[0]
    assert result.stdout == ""


def test_help_names_every_stage_and_imports_nothing_heavy():
    result = started_anew("--help")
    assert result.returncode == 0
    for command in STAGES:
        assert command in result.stdout
    probe = (
        "import sys, hlsd.cli.app; "
        "heavy = {'mujoco', 'numba', 'torch', 'pandas', 'matplotlib', 'numpy'}; "
        "print(sorted(heavy & set(sys.modules)))"
    )
    seen = subprocess.run(
        [sys.executable, "-c", probe], capture_output=True, text=True, check=True
    )
    assert seen.stdout.strip() == "[]"


def test_help_answers_at_once():
    """Half a second is promised, of a core: others may use the machine, too."""
    seconds = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        assert started_anew("--help").returncode == 0
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        seconds.append(used)
    assert 0.0 < min(seconds) < 0.5


def test_cli_py_in_a_checkout_is_the_same_command():
    result = subprocess.run(
        [sys.executable, "cli.py", "--help"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    anew = started_anew("--help").stdout
    assert result.stdout.replace("cli.py", "hlsd") == anew.replace(
        "python -m hlsd", "hlsd"
    )


def test_planners_lists_each_with_a_line():
    from hlsd.planners.registry import BUILT_IN

    result = hlsd("planners")
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    assert [line.split()[0] for line in lines] == list(BUILT_IN)
    for line, entry in zip(lines, BUILT_IN.values(), strict=True):
        assert line.endswith(f"  {entry.summary}")
    assert max(map(len, lines)) < 100


def test_installed_planners_are_listed_and_are_not_imported_for_it(monkeypatch):
    from importlib.metadata import EntryPoint

    from hlsd.core import registry as mechanism
    from hlsd.planners import registry

    group = registry.ENTRY_POINT_GROUP
    mine = EntryPoint("mine", "no_such_module:Mine", group)
    shadow = EntryPoint("dwa", "no_such_module:Dwa", group)
    points = {p.name: [("others 1.0", p)] for p in (mine, shadow)}
    monkeypatch.setattr(mechanism, "_announced", lambda _: {group: points})
    listed = registry.list_planners()
    assert [entry.name for entry in listed] == [*registry.BUILT_IN, "mine", "dwa"]
    assert listed[-2].summary == "plug-in no_such_module:Mine"
    assert listed[-1].fault == "'dwa' is built-in, which goes first"


def test_lists_go_on_past_broken_plug_ins_and_say_why(tmp_path):
    info = tmp_path / "others-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Name: others\nVersion: 1.0\n")
    (tmp_path / "others.py").write_text("import sys\nsys.exit(1)\n")
    kinds = ("planners", "robots", "suites", "protocols", "metrics", "perturbations")
    (info / "entry_points.txt").write_text(
        "".join(
            f"[hlsd.{kind}]\n\x1b[31mx = others:x\ny = others:y\n" for kind in kinds
        )
    )
    path = {"PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}"}
    result = hlsd("list", **path)
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.replace("\n", "").isprintable()
    why = "cannot be used: "
    assert result.stdout.count(why) == 2 * len(kinds)
    assert result.stdout.count("SystemExit: 1") == len(kinds)
    assert "barn300" in hlsd("worlds", "list", **path).stdout
    assert "jackal-ideal" in hlsd("robots", "list", **path).stdout
    out = tmp_path / "run"
    bench = ("bench", "--planner", PLANNER, "--worlds", 0, "--trials", 1, "--out", out)
    result = hlsd(*bench, **path)
    assert result.returncode == 0, result.stderr
    assert "rows lack metric 'y' of others 1.0" in result.stderr


def test_bench_prints_the_table_and_where_the_results_are(tmp_path):
    out = tmp_path / "run"
    result = hlsd(
        *("bench", "--planner", PLANNER, "--worlds", "0", "--trials", 1, "--out", out)
    )
    assert result.returncode == 0, result.stderr
    assert "| planner | n | success |" in result.stdout
    assert str(out) in result.stdout
    assert "1/1 episodes" in result.stderr, "progress goes to stderr"
    for name in ("episodes.csv", "summary.md", "summary.csv", "time_by_world.png"):
        assert (out / name).exists()
    again = hlsd(
        *("bench", "--planner", PLANNER, "--worlds", "0", "--trials", 1, "--out", out)
    )
    assert_refused(again, str(out), "already holds a finished run")


def started(command: list[object]) -> subprocess.Popen[str]:
    """A command that signals can stop, in a process group of its own."""
    return subprocess.Popen(
        [str(part) for part in command],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=heed_signals,
    )


def episodes_in(journal: Path) -> int:
    """Episodes that an unfinished run has done."""
    try:
        return journal.read_bytes().count(b'"row"')
    except FileNotFoundError:
        return 0


def test_an_interrupted_bench_says_so_and_the_same_command_goes_on(tmp_path):
    out = tmp_path / "run"
    command = [sys.executable, "-m", "hlsd", "bench", "--planner", PLANNER]
    command += ["--worlds", "0:300:20", "--trials", "2", "--jobs", "2", "--out", out]
    process = started(command)
    journal = out / "journal.jsonl"
    deadline = time.monotonic() + 60
    while not episodes_in(journal) and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: workers too
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors.strip().splitlines()[-1].startswith("hlsd: interrupted")
    assert "Traceback" not in errors
    assert 0 < episodes_in(journal) < 30
    again = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=True
    )
    assert "| 30 |" in again.stdout
    assert not journal.exists()


BAD_BENCH = [
    (["--planner", "hlsd11"], ["'hlsd11'", "did you mean 'hlsd10'"]),
    (["--planner", "nowhere:Planner"], ["'nowhere:Planner'", "No module named"]),
    (["--suite", "barn3000"], ["'barn3000'", "barn300"]),
    (["--worlds", "5:2"], ["5:2"]),
    (["--worlds", "a:b"], ["a:b"]),
    (["--worlds", "300"], ["300"]),
    (["--protocol", "hlsd2022"], ["'hlsd2022'", "hlsd2021"]),
    (["--robot", "husky"], ["'husky'", "jackal"]),
    (["--trials", "0"], ["0", "at least 1"]),
    (["--jobs", "0"], ["0", "at least 1"]),
    (["--seed", "-1"], ["-1", "0 or more"]),
    (["--policy", "somewhere.npz"], ["takes no policy"]),
]


@pytest.mark.parametrize(("arguments", "fragments"), BAD_BENCH)
def test_bad_bench_input_is_one_clear_line(arguments, fragments, tmp_path):
    out = tmp_path / "run"
    default = [] if "--planner" in arguments else ["--planner", PLANNER]
    result = hlsd("bench", *default, *arguments, "--out", out)
    assert_refused(result, *fragments)
    assert not out.exists(), "nothing half-written"


def test_a_missing_or_broken_policy_file_is_one_clear_line(tmp_path):
    out = tmp_path / "run"
    missing = tmp_path / "none.npz"
    result = hlsd("bench", "--planner", "hlsd10", "--policy", missing, "--out", out)
    assert_refused(result, str(missing), "hlsd train")
    shipped = ROOT / "hlsd" / "learning" / "policies" / "hlsd10.npz"
    broken = tmp_path / "broken.npz"
    broken.write_bytes(shipped.read_bytes()[:10_000])
    result = hlsd("bench", "--planner", "hlsd10", "--policy", broken, "--out", out)
    assert_refused(result, str(broken))
    assert not out.exists()


def test_a_policy_file_goes_with_a_single_planner(tmp_path):
    out = tmp_path / "run"
    two = ("--planner", "hlsd10", "--planner", "hlsd04", "--policy", "some.npz")
    assert_refused(hlsd("bench", *two, "--out", out), "--policy", "single --planner")
    assert not out.exists()


def test_an_output_folder_that_cannot_be_made_is_one_clear_line(tmp_path):
    file = tmp_path / "file"
    file.write_text("mine")
    result = hlsd("bench", "--planner", PLANNER, "--worlds", "0", "--out", file / "run")
    assert_refused(result, str(file / "run"))
    result = hlsd("bench", "--planner", PLANNER, "--worlds", "0", "--out", file)
    assert_refused(result, str(file))
    assert file.read_text() == "mine"


def test_a_folder_in_use_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    result = hlsd("bench", "--planner", PLANNER, "--worlds", "0", "--out", tmp_path)
    assert_refused(result, "thesis.tex", "not empty")
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize(
    ("arguments", "fragments"),
    [
        (["collect", "--preset", "2.0"], ["'2.0'", "1.0"]),
        (["collect", "--law", "normal"], ["'normal'", "matched"]),
        (["collect", "--robot", "husky"], ["'husky'"]),
        (["train", "--planner", "hlsd10", "--data", "none.npz"], ["none.npz"]),
        (["reproduce", "--suite", "barn3000"], ["'barn3000'", "barn300"]),
        (["reproduce", "--quick", "--jobs", "0"], ["0", "at least 1"]),
    ],
)
def test_bad_stage_input_is_one_clear_line(arguments, fragments, tmp_path):
    out = tmp_path / "out.npz"
    assert_refused(hlsd(*arguments, "--out", out, cwd=tmp_path), *fragments)
    assert list(tmp_path.iterdir()) == []


def test_stages_refuse_to_overwrite(tmp_path):
    out = tmp_path / "log.npz"
    out.write_text("mine")
    assert_refused(hlsd("collect", "--out", out), str(out), "exists")
    assert out.read_text() == "mine"
