"""`hlsd validate`: the course of a reference, joined references, chosen worlds."""

import dataclasses
import json

import numpy as np
import pytest

from hlsd.analysis.challenge import import_runs
from hlsd.analysis.courses import mark_of_2020
from hlsd.analysis.reference import read_reference
from hlsd.analysis.validate import validate_run
from hlsd.core.errors import HlsdError
from hlsd.data.worlds import load_suite
from hlsd.run.folder import write_imported
from hlsd.run.protocol import BARN2022, HLSD2021, get_protocol
from tests.analysis.test_challenge import out_txt
from tests.analysis.test_damaged_results import conditions, drive, row
from tests.analysis.test_gate import hlsd
from tests.analysis.test_reference import HEAD, write
from tests.conftest import shared

WORLDS = (0, 6, 12, 18)
RULED = "world,planner,trial,time_s,protocol\n"


def make_run(folder, protocol=HLSD2021, worlds=WORLDS, planner="mine", **changed):
    """A run of two trials a world, all successes of 12 s and more."""
    held = conditions(protocol, **changed.pop("conditions", {}))
    rows = [
        row(held, planner, w, t, time_s=f"{12 + 0.31 * n + t:.4f}", **changed)
        for n, w in enumerate(worlds)
        for t in range(2)
    ]
    write_imported(folder, rows, {}, held)
    return folder


def csv_of(path, times, worlds=WORLDS, planner="gazebo", ending=""):
    """A CSV of trials: the same times in each world, a little longer in each."""
    lines = [
        f"{w},{planner},{t},{time + 0.0137 * n if time < 25 else time}{ending}\n"
        for n, w in enumerate(worlds)
        for t, time in enumerate(times)
    ]
    return write(path, (RULED if ending else HEAD) + "".join(lines))


@pytest.fixture
def command(monkeypatch, capsys):
    return lambda *arguments: hlsd(monkeypatch, capsys, "validate", *arguments)


def refusal(result, *fragments):
    """The one line by which a command refused, which says all of this."""
    code, out, err = result
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    for fragment in fragments:
        assert fragment in err
    return err


def printed(result, *fragments):
    """What a command printed, which says all of this."""
    code, out, err = result
    assert (code, err) == (0, "")
    for fragment in fragments:
        assert fragment in out
    return out


# ---------------------------------------------------------------- the shared references


@pytest.mark.parametrize("planner", ["dwa_0.5", "eband"])
@pytest.mark.parametrize("name", ["gazebo_2020_trials", "gazebo_2020_trials_100"])
def test_the_trials_of_2020_are_of_one_course(tmp_path, command, name, planner):
    """As they are: without extra options there, and refused for the Challenge's."""
    path = shared("reference", f"{name}.csv")
    options = ("--against", path, "--reference-planner", planner)
    first = 0 if name == "gazebo_2020_trials" else 1
    worlds = range(first, 60, 6)
    run = make_run(tmp_path / "run", worlds=worlds)
    printed(command(run, *options), "exactly 30 s", "as the evaluator of hlsd2021 has")
    for protocol in ("barn2022", "barn2024"):
        run = make_run(tmp_path / protocol, get_protocol(protocol), worlds)
        refusal(
            command(run, *options),
            f"does not look driven under {protocol}",
            "as the evaluator of hlsd2021 has it",
            "--reference-protocol",
            "--other-course",
        )


def imported(tmp_path, protocol, name="run"):
    """A run of the Challenge in real worlds."""
    runs = [(w, 1, 0, 0, 20.0 + n + w / 50) for w in WORLDS for n in range(2)]
    path = out_txt(tmp_path / f"{name}.txt", runs, protocol)
    import_runs(path, "mine", protocol, "barn300", tmp_path / name)
    return tmp_path / name


def test_the_runs_of_2022_are_of_one_course(tmp_path, command):
    path = shared("reference", "gazebo_2022_dwa_out.txt")
    runs = [(w, 1, 0, 0, 20.0 + w / 50 + n) for w in (0, 12, 24, 36) for n in (0, 1)]
    for protocol in ("barn2022", "barn2024"):
        out = out_txt(tmp_path / f"{protocol}.txt", runs, protocol)
        import_runs(out, "mine", protocol, "barn300", tmp_path / protocol)
    printed(command(tmp_path / "barn2022", "--against", path), "as its metric shows")
    refusal(
        command(tmp_path / "barn2024", "--against", path),
        "was driven under barn2022, as its metric shows",
        "the run under barn2024",
        "validate a run under barn2022",
        "--other-course",
    )
    digest = {"suite_digest": load_suite("barn300").digest}
    run = make_run(tmp_path / "old", worlds=(0, 12, 24, 36), conditions=digest)
    refusal(
        command(run, "--against", path),
        "an out.txt of the BARN Challenge, by its metric of barn2022,",
        "the run was driven under hlsd2021",
    )
    found = validate_run(run, path, other_course=True)
    assert found.course.protocol == BARN2022
    assert found.course.limit_s == 100
    assert found.agreement.time_s.reference.value > 30


# ---------------------------------------------------------------------- what times show


MARKS = {
    "two at 50 s and none later": ([12.1, 13.2, 50.001, 50.016], True),
    "one at 50 s": ([12.1, 13.2, 14.7, 50.001], False),
    "two at 50 s, and a later one": ([12.1, 50.001, 50.016, 61.0], False),
    "two near 50 s": ([12.1, 13.2, 48.9, 51.2], False),
    "30 s often": ([12.1, 13.2, 30.0, 30.0, 30.0], True),
    "30 s twice": ([12.1, 13.2, 30.0, 30.0], False),
    "whole seconds": ([12.0, 12.0, 30.0, 30.0, 30.0], False),
    "30 s often, and times of a longer limit": ([61.0, 30.0, 30.0, 30.0], False),
}


@pytest.mark.parametrize("name", MARKS)
def test_the_mark_of_the_evaluator_of_2020(tmp_path, name):
    times, marked = MARKS[name]
    lines = [f"0,a,{n},{time}\n" for n, time in enumerate(times)]
    held = read_reference([write(tmp_path / "t.csv", HEAD + "".join(lines))])
    assert bool(mark_of_2020(held, 30.0)) == marked
    if "30 s" in name:
        assert mark_of_2020(held, 0.0) == "", "no time is a penalty, it was said"


def test_a_run_that_the_file_calls_a_success_is_no_timeout(tmp_path):
    lines = "".join(f"0,a,{n},50.001,ok\n" for n in range(3))
    head = "world,planner,trial,time_s,status\n"
    assert mark_of_2020(read_reference([write(tmp_path / "t", head + lines)]), 30) == ""


def test_times_beyond_the_run_s_limit_are_of_another_course(tmp_path, command):
    run = make_run(tmp_path / "run")
    path = csv_of(tmp_path / "t.csv", (20.0, 21.0, 99.5))
    refusal(
        command(run, "--against", path),
        "does not look driven under hlsd2021",
        "4 of its runs took longer than 50 s, the limit of hlsd2021, up to 99.5 s",
    )
    # They count as they are, not the limit of the run.
    found = validate_run(run, path, other_course=True)
    assert found.course.limit_s == 100
    assert found.agreement.reference.mean_time_s[0] == pytest.approx(140.5 / 3)
    said = ("--reference-protocol", "hlsd2021")
    printed(
        command(run, "--against", path, *said),
        "under hlsd2021, as the run, as is stated",
        "It is said to be of hlsd2021, but 4 of its runs took longer than 50 s",
    )
    # An evaluator that looks now and then is a little late.
    late = csv_of(tmp_path / "late.csv", (20.0, 21.0, 50.9))
    assert validate_run(run, late).course.same is None


def test_no_run_is_faster_than_the_robot(tmp_path, command):
    """6.316 m, of which 0.316 m before the clock: 3 s at 2 m/s, less 5 %."""
    run = make_run(tmp_path / "run", shortest_length_m="6.316")
    slow = csv_of(tmp_path / "slow.csv", (2.9, 12.0))
    assert validate_run(run, slow).course.same is None
    fast = csv_of(tmp_path / "fast.csv", (2.8, 12.0))
    refusal(command(run, "--against", fast), "4 of its runs are faster")
    # A robot that nobody knows may be fast, and so may a run that failed.
    other = make_run(
        tmp_path / "other", shortest_length_m="6.316", conditions={"robot": "hare"}
    )
    assert validate_run(other, fast).course.same is None
    lines = [line for line in fast.read_text().splitlines() if ",0,2." in line]
    text = HEAD.replace("\n", ",status\n") + "".join(f"{x},flip\n" for x in lines)
    assert validate_run(run, write(tmp_path / "f.csv", text)).course.same is None


def test_a_reference_that_says_nothing_is_said_to(tmp_path, command):
    run = make_run(tmp_path / "run")
    path = csv_of(tmp_path / "t.csv", (14.0, 15.0))
    out = printed(command(run, "--against", path))
    (line,) = [line for line in out.splitlines() if "does not say" in line]
    assert "that it is barn300 under hlsd2021, as the run, is your word" in line
    assert "--reference-protocol NAME or a column protocol states it" in line
    held = json.loads(printed(command(run, "--against", path, "--json")))
    assert held["reference"]["protocol"] is None
    assert held["reference"]["same_course"] is None
    assert held["reference"]["protocol_from"] == "nothing"


# ------------------------------------------------------------------- what is said of it


def test_a_column_says_the_protocol(tmp_path, command):
    run = make_run(tmp_path / "run")
    same = csv_of(tmp_path / "same.csv", (14.0, 15.0), ending=",hlsd2021")
    printed(command(run, "--against", same), "hlsd2021, as the run, as its column")
    found = validate_run(run, same).as_json()["reference"]
    assert found["protocol"] == "hlsd2021"
    assert (found["protocol_from"], found["same_course"]) == ("column", True)
    other = csv_of(tmp_path / "other.csv", (14.0, 15.0), ending=",barn2022")
    refusal(
        command(run, "--against", other),
        "was driven under barn2022, as its column protocol says, and the run under "
        "hlsd2021",
        "validate a run under barn2022",
    )
    refusal(
        command(run, "--against", other, "--reference-protocol", "hlsd2021"),
        "--reference-protocol is hlsd2021, but",
        "names barn2022",
    )
    unknown = csv_of(tmp_path / "unknown.csv", (14.0, 15.0), ending=",hlsd2012")
    refusal(command(run, "--against", unknown), "'hlsd2012'", "mean 'hlsd2021'")
    # Text of a file loads nothing.
    module = csv_of(tmp_path / "m.csv", (14.0,), ending=",hlsd.run.protocol:BARN2022")
    refusal(command(run, "--against", module), "unknown protocol 'hlsd.run.protocol:")
    empty = csv_of(tmp_path / "empty.csv", (14.0, 15.0), ending=", ")
    assert validate_run(run, empty).course.same is None


def test_a_reference_is_of_one_protocol(tmp_path):
    run = make_run(tmp_path / "run")
    text = RULED + "0,a,0,9,hlsd2021\n6,a,0,9,hlsd2021\n12,a,0,9,{}\n0,b,0,9,barn2022\n"
    for name, shown in (("barn2022", "barn2022"), ("", "none")):
        path = write(tmp_path / "t.csv", text.format(name))
        with pytest.raises(HlsdError, match=f"line 4: protocol {shown}, .*hlsd2021"):
            validate_run(run, path, reference_planner="a")
    # Another planner's do not matter.
    path = write(tmp_path / "t.csv", text.format("hlsd2021"))
    assert validate_run(run, path, reference_planner="a").course.same is True


def test_a_protocol_of_one_s_own_is_known_by_the_run(tmp_path):
    """It need not be installed: the run recorded its rules."""
    own = dataclasses.replace(HLSD2021, name="mine2026")
    run = make_run(tmp_path / "run", own)
    path = csv_of(tmp_path / "t.csv", (14.0, 15.0), ending=",mine2026")
    assert validate_run(run, path).course.same is True
    path = csv_of(tmp_path / "u.csv", (14.0, 15.0))
    stated = validate_run(run, path, reference_protocol="mine2026")
    assert stated.course.protocol == own


def test_the_protocol_is_stated(tmp_path, command):
    run = make_run(tmp_path / "run")
    path = csv_of(tmp_path / "t.csv", (14.0, 15.0))
    stated = ("--against", path, "--reference-protocol")
    printed(command(run, *stated, "hlsd2021"), "hlsd2021, as the run, as is stated")
    refusal(command(run, *stated, "barn2022"), "under barn2022, as is stated")
    refusal(command(run, *stated, "barn"), "unknown protocol 'barn'")


def test_another_course_is_compared_in_order_alone(tmp_path, command):
    """The reference's failures stand at its own limit, ours at ours."""
    run = make_run(tmp_path / "run", BARN2022)
    path = csv_of(tmp_path / "t.csv", (14.0, 15.0, 50.003))
    refusal(command(run, "--against", path), "4 of its runs end at 50 s, none later")
    options = ("--against", path, "--other-course")
    out = printed(
        command(run, *options),
        "by other rules, so that times and success are not compared, mine's hard",
        "the order of the worlds can be compared, times and success cannot",
        "A failed run of gazebo counts 50 s.",
        "4 reference runs took 50 s or longer and count as timeouts at 50 s",
    )
    assert " x " not in out
    assert " points |" not in out
    held = json.loads(printed(command(run, *options, "--json")))
    assert held["verdict"]["times"] == held["verdict"]["success"] == "not compared"
    assert held["reference"]["limit_s"] == 50
    assert held["success"]["reference"]["value"] == pytest.approx(2 / 3)
    late = held["time_at_limit_s"]["reference"]["value"]
    assert late == pytest.approx(held["time_s"]["reference"]["value"])
    # It is a permission: a reference of the same course is compared as without it.
    same = csv_of(tmp_path / "s.csv", (24.0, 25.0))
    one, two = (
        validate_run(run, same, other_course=x).as_json() for x in (True, False)
    )
    assert one == two


# --------------------------------------------------------------------------- an out.txt


def test_an_out_txt_whose_metric_shows_nothing_may_be_stated(tmp_path, command):
    run = imported(tmp_path, "barn2022")
    lines = [f"{w} 1 0 0 {25 + w / 9:.4f} 0.9\n" for w in WORLDS]
    path = write(tmp_path / "o.txt", "".join(lines))
    printed(
        command(run, "--against", path),
        "an out.txt of the BARN Challenge, whose metric does not show the rules",
        "4 of 4 successes is neither the score of barn2022 nor AT/OT",
    )
    stated = ("--against", path, "--reference-protocol")
    printed(command(run, *stated, "barn2022"), "as is stated", "is neither the score")
    refusal(command(run, *stated, "barn2024"), "under barn2024, as is stated")
    refusal(
        command(run, *stated, "hlsd2021"),
        "--reference-protocol is hlsd2021, which has no score",
    )
    failures = "".join(f"{w} 0 1 0 5.0 0.0\n" for w in WORLDS)
    found = validate_run(run, write(tmp_path / "f.txt", failures))
    assert (found.course.same, found.doubts) == (None, ())


@pytest.mark.parametrize("ratio", [False, True])
@pytest.mark.parametrize("protocol", ["barn2022", "barn2024"])
def test_the_metric_tells_the_year(tmp_path, protocol, ratio):
    runs = [(w, 1, 0, 0, 31.0 + n) for n, w in enumerate(range(0, 60, 6))]
    path = out_txt(tmp_path / "out.txt", runs, protocol, ratio)
    for own in ("barn2022", "barn2024"):
        run = imported(tmp_path, own, own)
        if own == protocol:
            assert validate_run(run, path).course.source == "metric"
        else:
            with pytest.raises(HlsdError, match=f"driven under {protocol}, as its met"):
                validate_run(run, path)


# --------------------------------------------------------------------- imported folders


def test_an_imported_run_is_a_reference(tmp_path, command):
    run = imported(tmp_path, "barn2022")
    gazebo = imported(tmp_path, "barn2022", "gazebo")
    printed(command(run, "--against", gazebo), "as its run.json says", "1.00 times")
    found = validate_run(run, gazebo).as_json()
    assert found["reference"]["format"] == "imported run"
    assert found["reference"]["protocol_from"] == "run.json"
    other = imported(tmp_path, "barn2024", "later")
    refusal(
        command(run, "--against", other),
        "under barn2024, as its run.json says, and the run under barn2022",
    )
    assert validate_run(run, other, other_course=True).course.same is False
    stated = ("--reference-protocol", "barn2024")
    refusal(command(run, "--against", gazebo, *stated), "names barn2022")
    refusal(command(run, "--against", gazebo / "episodes.csv"), "is its folder")
    assert "`hlsd compare`" in refusal(command(run, "--against", drive(tmp_path / "d")))


def test_failures_of_an_imported_run_stand_at_the_limit(tmp_path):
    runs = [(w, n, 1 - n, 0, 20.0) for w in WORLDS for n in (0, 1)]
    path = out_txt(tmp_path / "out.txt", runs)
    import_runs(path, "gazebo", "barn2022", "barn300", tmp_path / "gazebo")
    run = imported(tmp_path, "barn2022")
    one = validate_run(run, tmp_path / "gazebo").agreement
    two = validate_run(run, path).agreement
    assert one.as_json() == two.as_json()
    assert one.time_s.reference.value == pytest.approx(60)


def test_rules_and_worlds_of_an_imported_run_are_compared(tmp_path):
    run = make_run(tmp_path / "run", BARN2022)
    rules = dataclasses.replace(BARN2022, limit_s=80.0, version="2")
    changed = make_run(tmp_path / "rules", rules, planner="gazebo")
    with pytest.raises(
        HlsdError, match=r"other rules .*barn2022: the protocol's limit"
    ):
        validate_run(run, changed)
    worlds = {"suite_digest": "d2"}
    moved = make_run(tmp_path / "moved", BARN2022, conditions=worlds)
    for allowed in (False, True):
        with pytest.raises(HlsdError, match=r"suite digest \(d2, d1\)"):
            validate_run(run, moved, other_course=allowed)
    # A planner is chosen by the reference's option, or behind the run's folder.
    both = tmp_path / "both"
    held = conditions(BARN2022)
    rows = [row(held, p, w, 0) for p in ("a", "b") for w in WORLDS]
    write_imported(both, rows, {}, held)
    with pytest.raises(
        HlsdError, match=r"several planners \(a, b\): say which, .*both:a"
    ):
        validate_run(run, both)
    assert validate_run(run, both, reference_planner="b").reference.name == "b"


# -------------------------------------------------------------------- joined references


def test_references_are_joined(tmp_path, command):
    run = make_run(tmp_path / "run")
    whole = csv_of(tmp_path / "all.csv", (14.0, 15.5, 30.0))
    lines = whole.read_text().splitlines(keepends=True)
    one = write(tmp_path / "one.csv", "".join(lines[:7]))
    two = write(tmp_path / "two.csv", HEAD + "".join(lines[7:]))
    options = ("--against", one, "--against", two, "--json")
    joined = printed(command(run, *options))
    assert joined == printed(command(run, "--against", whole, "--json"))
    assert json.loads(joined)["worlds"] == 4
    refusal(
        command(run, "--against", two, "--against", whole),
        f"'{two}' and '{whole}' both hold world 12, trial 0 of 'gazebo'",
    )
    refusal(command(run, "--against", two, "--against", two), "both hold world 12")
    # Other trials of the same worlds are other runs.
    later = lines[1].replace(",gazebo,0,", ",gazebo,9,")
    more = validate_run(run, [whole, write(tmp_path / "more.csv", HEAD + later)])
    assert more.agreement.reference.runs.tolist() == [4, 3, 3, 3]
    other = write(tmp_path / "o.txt", "0 1 0 0 22.2 4.1\n")
    refusal(
        command(run, "--against", one, "--against", other),
        f"'{one}' is a CSV and '{other}' is an out.txt",
    )


def test_joined_files_are_of_one_protocol(tmp_path):
    run = make_run(tmp_path / "run")
    one = csv_of(tmp_path / "1.csv", (14.0,), WORLDS[:2], ending=",hlsd2021")
    two = csv_of(tmp_path / "2.csv", (14.0,), WORLDS[2:], ending=",barn2022")
    with pytest.raises(HlsdError, match=r"2\.csv' line 2: protocol barn2022"):
        validate_run(run, (one, two))


def test_out_txt_files_and_imported_runs_are_joined(tmp_path):
    run = imported(tmp_path, "barn2022")
    runs = [(w, 1, 0, 0, 25.0 + w) for w in WORLDS for _ in range(2)]
    whole = out_txt(tmp_path / "all.txt", runs)
    halves = [
        out_txt(tmp_path / f"{n}.txt", part)
        for n, part in enumerate((runs[:4], runs[4:]))
    ]
    joined = validate_run(run, halves)
    assert joined.reference.name == "0.txt + 1.txt"
    assert joined.agreement.as_json() == validate_run(run, whole).agreement.as_json()
    # It numbers no trials, so that the same world might be the same runs.
    with pytest.raises(HlsdError, match="both hold world 12: "):
        validate_run(run, [halves[1], whole])
    folders = []
    for half in halves:
        folders.append(tmp_path / half.stem)
        import_runs(half, "gazebo", "barn2022", "barn300", folders[-1])
    again = validate_run(run, folders)
    assert again.reference.name == "gazebo"
    assert again.agreement.as_json() == joined.agreement.as_json()
    with pytest.raises(HlsdError, match="both hold world 0, trial 0"):
        validate_run(run, [folders[0], folders[0]])
    later = imported(tmp_path, "barn2024", "later")
    with pytest.raises(HlsdError, match="differ in their protocol"):
        validate_run(run, [folders[0], later], reference_planner=None)


# ------------------------------------------------------------------------- their worlds


def test_worlds_are_chosen_as_in_bench(tmp_path, command):
    worlds = range(0, 60, 3)
    run = make_run(tmp_path / "run", worlds=worlds)
    path = csv_of(tmp_path / "t.csv", (14.0, 15.0, 30.0), worlds)
    every = json.loads(printed(command(run, "--against", path, "--json")))
    assert (every["worlds"], every["worlds_chosen"]) == (20, None)
    assert every["reference"]["penalties"] == 20
    options = ("--against", path, "--worlds", "3:300:6", "--json")
    held = json.loads(printed(command(run, *options)))
    assert [w["world"] for w in held["per_world"]] == list(range(3, 60, 6))
    assert held["per_world"] == [w for w in every["per_world"] if w["world"] % 6]
    assert held["worlds_chosen"] == "3:300:6"
    # Nothing that was left out by choice is counted.
    assert held["reference"]["penalties"] == 10
    assert (held["worlds_only_ours"], held["worlds_only_reference"]) == (0, 0)
    alone = csv_of(tmp_path / "a.csv", (14.0, 15.0, 30.0), range(3, 60, 6))
    cut = validate_run(make_run(tmp_path / "cut", worlds=range(3, 60, 6)), alone)
    chosen = validate_run(run, path, worlds=range(3, 60, 6))
    assert len(chosen.run.rows) == 20
    np.testing.assert_array_equal(
        chosen.agreement.ours.worlds, cut.agreement.ours.worlds
    )
    out = printed(command(run, *options[:-1]), "10 worlds, 20 runs against 30")
    assert "Left out: " not in out


def test_worlds_that_cannot_be_compared_are_refused(tmp_path, command):
    run = make_run(tmp_path / "run")
    path = csv_of(tmp_path / "t.csv", (14.0, 15.0), (0, 6, 12, 24))
    options = ("--against", path, "--worlds")
    refusal(command(run, *options, "0,6,99"), "the comparison has no world 99")
    refusal(command(run, *options, "0,6"), "share 2 worlds")
    refusal(command(run, *options, "25:"), "select nothing")
    refusal(command(run, *options, "a"), "cannot read worlds 'a'")
    # One that a single side holds is left out, and counted.
    held = validate_run(run, path, worlds="0:13,18,24").agreement
    assert (held.only_ours, held.only_reference) == (1, 1)
