"""Suites: loading, generating, importing, selecting."""

import hashlib
import pickle
import shutil

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hlsd.core.errors import HlsdError
from hlsd.core.resources import resource
from hlsd.data import barn
from hlsd.data.suite_files import read_seed_table, read_world_text
from hlsd.data.worlds import (
    CYLINDER_RADIUS_M,
    CYLINDER_TOP_M,
    Suite,
    generate_suite,
    import_suite,
    load_suite,
    suite_names,
)
from tests.conftest import shared

BARN300 = load_suite("barn300")

# Of `generate_suite(name, 12, 3)`: a change here changes everybody's generated suites.
GENERATED_SHA256 = "dcb06cafeb6050aa482748bb1a515962ae662661fa17906250c60bbf4be3beac"


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("HLSD_HOME", str(tmp_path / "home"))
    return tmp_path / "home" / "suites"


class Numbered:
    """A reader that has indices and nothing else."""

    def __init__(self, *indices):
        self.indices = indices

    def read(self, index):
        raise NotImplementedError

    def digests(self, index):
        raise NotImplementedError


def suite_of(*indices):
    return Suite("test", "1", "nowhere", Numbered(*indices))


def bytes_of(folder):
    return {file.name: file.read_bytes() for file in sorted(folder.iterdir())}


def test_barn300_is_there_and_lazy():
    assert len(BARN300) == 300
    assert BARN300.indices == tuple(range(300))
    assert "barn300" in suite_names()
    world = BARN300[255]
    assert (world.suite, world.index) == ("barn300", 255)
    assert not world.grid.flags.writeable
    assert not world.path.flags.writeable
    assert world.cylinders_xy().shape[1] == 2
    assert (CYLINDER_RADIUS_M, CYLINDER_TOP_M) == (0.075, 0.5)


def test_worlds_and_suites_travel_between_processes():
    world = pickle.loads(pickle.dumps(BARN300))[7]
    copy = pickle.loads(pickle.dumps(world))
    assert np.array_equal(copy.grid, BARN300[7].grid)
    assert np.array_equal(copy.path, BARN300[7].path)


def test_digest_is_as_documented():
    lines = []
    for row in (resource("worlds") / "barn300.csv").read_text().splitlines()[1:]:
        index, *_, grid, path = row.split(",")
        lines.append(f"{index} {grid} {path}\n")
    assert BARN300.digest == hashlib.sha256("".join(lines).encode()).hexdigest()


def test_a_changed_seed_is_noticed(tmp_path):
    text = (resource("worlds") / "barn300.csv").read_text()
    file = tmp_path / "seeds.csv"
    file.write_text(text.replace("482165344995270980", "482165344995270981"))
    table = read_seed_table(file)
    table.read(1)
    with pytest.raises(HlsdError, match=r"world 0 of .* does not come out as recorded"):
        table.read(0)
    file.write_text(text.replace("world,seed", "world,sead"))
    with pytest.raises(HlsdError, match="not a complete table of seeds"):
        read_seed_table(file)


def test_unknown_suite_lists_what_exists():
    generate_suite("mine", 1, 0)
    with pytest.raises(
        HlsdError, match="known are barn300, course, mine; did you mean 'barn300'"
    ):
        load_suite("barn30")
    with pytest.raises(HlsdError, match="there is no suite folder 'no/where'"):
        load_suite("no/where")


@pytest.mark.parametrize(
    ("indices", "words"),
    [
        ((0, 1, 2), "worlds 0 to 2"),
        ((0, 6, 12), "worlds 0 to 12 in steps of 6"),
        ((0, 6, 13), "3 worlds between 0 and 13"),
        ((4,), "world 4 only"),
    ],
)
def test_unknown_world_says_which_exist(indices, words):
    with pytest.raises(HlsdError, match=f"'test' has no world 9: it has {words}"):
        suite_of(*indices)[9]


# --- selections ---------------------------------------------------------------------

part = st.one_of(st.none(), st.integers(0, 40))


@given(start=part, stop=part, step=st.one_of(st.none(), st.integers(1, 9)))
def test_slices_select_as_python_does(start, stop, step):
    text = ":".join("" if n is None else str(n) for n in (start, stop, step))
    expected = tuple(range(30)[slice(start, stop, step)])
    if expected:
        assert suite_of(*range(30)).select(text) == expected
    else:
        with pytest.raises(HlsdError, match="select nothing"):
            suite_of(*range(30)).select(text)


@given(st.sets(st.integers(0, 60), min_size=1), st.integers(0, 60), st.integers(1, 9))
def test_slices_go_by_index_where_there_are_gaps(indices, start, step):
    expected = tuple(sorted(i for i in indices if i in range(start, 99, step)))
    suite = suite_of(*sorted(indices))
    if expected:
        assert suite.select(f"{start}:99:{step}") == expected


@given(st.lists(st.integers(0, 29), min_size=1))
def test_lists_select_each_once_in_order(chosen):
    text = ",".join(map(str, chosen))
    assert suite_of(*range(30)).select(text) == tuple(sorted(set(chosen)))


@given(st.text(alphabet="0123456789:,- ab", max_size=12))
def test_any_text_selects_known_worlds_or_is_an_error(text):
    suite = suite_of(0, 6, 12)
    try:
        chosen = suite.select(text)
    except HlsdError as error:
        assert "\n" not in str(error)  # noqa: PT017
    else:
        assert chosen
        assert set(chosen) <= set(suite.indices)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("5:2", "select nothing: start must be below stop"),
        ("300:", "select nothing"),
        ("", "cannot read worlds ''"),
        ("3,,4", "cannot read"),
        ("-3", "cannot read"),
        ("1:2:3:4", "cannot read"),
        ("0:9:0", "step must be 1 or more"),
        ("300", "no world 300: it has worlds 0 to 299"),
        ("3,17,400", "no world 400"),
        ("٣", "cannot read"),
        ("1.5", "cannot read"),
    ],
)
def test_bad_selections_say_what_would_be_right(text, words):
    with pytest.raises(HlsdError) as caught:
        BARN300.select(text)
    assert words in str(caught.value)


def test_selections_mix_and_huge_bounds_are_cheap():
    assert BARN300.select("0:300:60, 7") == (0, 7, 60, 120, 180, 240)
    assert BARN300.select("298:999999999") == (298, 299)


# --- generated suites ---------------------------------------------------------------


def test_generated_bytes_depend_on_the_seed_alone(home):
    first = generate_suite("first", 12, 3)
    again = generate_suite("again", 12, 3)
    generate_suite("other", 3, 4)
    assert bytes_of(home / "first") == bytes_of(home / "again")
    assert first.digest == again.digest
    assert (
        bytes_of(home / "other")["world_0.txt"]
        != bytes_of(home / "first")["world_0.txt"]
    )
    total = hashlib.sha256()
    for name, data in bytes_of(home / "first").items():
        total.update(name.encode() + b"\n" + data)
    assert total.hexdigest() == GENERATED_SHA256


def test_a_longer_suite_begins_with_the_shorter_one(home):
    generate_suite("short", 2, 9)
    generate_suite("long", 4, 9)
    short, long = bytes_of(home / "short"), bytes_of(home / "long")
    assert short["world_1.txt"] == long["world_1.txt"]


def test_generated_worlds_take_the_groups_in_turn_and_follow_the_rules(home):
    suite = generate_suite("mine", 24, 1)
    assert suite.indices == tuple(range(24))
    for world in suite:
        assert barn.fault(barn.BarnMap(world.grid, world.path)) is None
        note = (home / "mine" / f"world_{world.index}.txt").read_text().split("\n")[0]
        fill, smoothing = barn.groups()[world.index % 12]
        assert note.endswith(f"fill {fill:.2f}, smoothing {smoothing}")
        seed = int(note.split(",")[0].removeprefix("seed "))
        made = barn.generate(barn.MapRecipe(seed, fill, smoothing))
        assert np.array_equal(made.grid, world.grid)
        assert np.array_equal(made.path, world.path)


def test_names_are_not_taken_twice_and_stay_in_their_folder(home):
    generate_suite("mine", 1, 0)
    before = bytes_of(home / "mine")
    for name in ("mine", "barn300"):
        with pytest.raises(HlsdError, match="exists already"):
            generate_suite(name, 1, 1)
    for name in ("../up", "a/b", "", ".hidden", "a b"):
        with pytest.raises(HlsdError, match="is not a name for a suite"):
            generate_suite(name, 1, 1)
    with pytest.raises(HlsdError, match="cannot generate 0 worlds"):
        generate_suite("none", 0, 1)
    assert bytes_of(home / "mine") == before
    assert [file.name for file in home.iterdir()] == ["mine"]


def test_a_suite_is_stored_whole_or_not_at_all(home, monkeypatch):
    made = barn.generate

    def fail_later(*given):
        if any(home.glob(".mine.*/world_0.txt")):
            raise KeyboardInterrupt
        return made(*given)

    monkeypatch.setattr(barn, "generate", fail_later)
    with pytest.raises(KeyboardInterrupt):
        generate_suite("mine", 5, 0)
    assert list(home.iterdir()) == []


def test_unwritable_home_is_one_line(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("HLSD_HOME", str(tmp_path / "file"))
    with pytest.raises(HlsdError, match="cannot write"):
        generate_suite("mine", 1, 0)


# --- stored text --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("grid\n", "", "no line 'grid'"),
        ("path\n", "", "then 'path'"),
        ("#\n", "#.\n", "line 3: expected 30 of"),
        ("###", "#x#", "line 3: expected 30 of"),
        ("########\n.", "#######.\n.", "side wall"),
        ("path\n", "path\nx\n", "line 34: expected 'row column'"),
        ("path\n", "path\n0 5\n", "column 0 to column 29"),
        ("path\n", "path\n1 0\n", "obstacle|jumps"),
    ],
)
def test_damaged_text_is_refused_with_its_line(home, old, new, words):
    generate_suite("mine", 1, 0)
    file = home / "mine" / "world_0.txt"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(HlsdError, match=words) as caught:
        load_suite("mine")[0]
    assert "world_0.txt" in str(caught.value)


def test_every_truncation_of_a_stored_world_is_refused_or_harmless(home, tmp_path):
    generate_suite("mine", 1, 0)
    text = (home / "mine" / "world_0.txt").read_text()
    whole = read_world_text(home / "mine" / "world_0.txt")
    file = tmp_path / "world.txt"
    for length in range(0, len(text), 7):
        file.write_text(text[:length])
        try:
            cut = read_world_text(file)
        except HlsdError:
            continue
        assert np.array_equal(cut.path, whole.path)  # only the last newline is gone


def test_missing_world_and_damaged_header_are_refused(home):
    generate_suite("mine", 2, 0)
    header = home / "mine" / "suite.toml"
    text = header.read_text()
    for wrong in (
        "x",
        text.replace("format = 1", "format = 9"),
        "format = 1\nworlds = 2",
    ):
        header.write_text(wrong)
        with pytest.raises(HlsdError, match=r"suite\.toml"):
            load_suite("mine")
    header.write_text(text)
    (home / "mine" / "world_1.txt").unlink()
    with pytest.raises(HlsdError, match=r"has 1 files .* worlds = 2"):
        load_suite("mine")


# --- imported suites ----------------------------------------------------------------


def test_import_round_trip_keeps_indices_grids_paths_and_digest(home):
    folder = shared("barn")
    imported = import_suite(folder, "real")
    assert imported.indices == tuple(range(0, 300, 6))
    for world in imported:
        ours = BARN300[world.index]
        assert np.array_equal(world.grid, ours.grid)
        assert np.array_equal(world.path, ours.path)
    assert load_suite("real").digest == imported.digest
    assert load_suite("real").select("0:100:12") == tuple(range(0, 100, 12))
    stored = load_suite(str(home / "real"))
    assert stored.digest == imported.digest


def test_published_folder_is_a_suite_as_it_is():
    suite = load_suite(str(shared("barn")))
    assert suite.name == "barn"
    assert np.array_equal(suite[294].grid, BARN300[294].grid)
    with pytest.raises(HlsdError, match="worlds 0 to 294 in steps of 6"):
        suite[1]


def test_a_failed_import_writes_nothing(tmp_path, home):
    folder = tmp_path / "BARN"
    for kind, suffix in (("world", "world"), ("path", "npy")):
        to = folder / "path_files" if kind == "path" else folder
        to.mkdir(exist_ok=True)
        for index in (0, 6):
            name = f"{kind}_{index}.{suffix}"
            shutil.copy(shared("barn", f"{kind}_files", name), to / name)
    world = folder / "world_6.world"
    world.write_bytes(world.read_bytes()[:5000])
    with pytest.raises(
        HlsdError, match=r"world_6\.world is not a complete Gazebo world"
    ):
        import_suite(folder, "broken")
    with pytest.raises(HlsdError, match="there is no folder"):
        import_suite(tmp_path / "nowhere", "broken")
    assert not home.exists() or list(home.iterdir()) == []


def test_a_folder_with_an_odd_name_can_be_imported(tmp_path):
    folder = tmp_path / 'a "b" \\ é\x7f\n'
    for kind in ("grid", "path"):
        to = folder / f"{kind}_files"
        to.mkdir(parents=True)
        shutil.copy(shared("barn", f"{kind}_files", f"{kind}_6.npy"), to)
    import_suite(folder, "odd")
    assert repr(folder.name) in load_suite("odd").source
