"""Published files in both layouts, whole and damaged."""

import shutil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hlsd.core.errors import HlsdError
from hlsd.core.resources import resource
from hlsd.data import barn, grids
from hlsd.data.barn_files import infer_grid, open_folder, read_grid, read_world
from hlsd.data.suite_files import read_seed_table
from tests.conftest import shared

PUBLISHED = range(0, 300, 6)
FEW = (0, 6, 120)


@pytest.fixture
def dataset(tmp_path):
    """A few worlds as the dataset itself lays them out."""
    folder = tmp_path / "dataset"
    for kind, suffix in (("grid", "npy"), ("path", "npy"), ("cspace", "npy")):
        copy(folder / f"{kind}_files", kind, suffix)
    copy(folder / "world_files", "world", "world")
    return folder


@pytest.fixture
def challenge(tmp_path):
    """A few worlds as the BARN Challenge lays them out, paths inside."""
    folder = tmp_path / "BARN"
    copy(folder, "world", "world")
    copy(folder / "path_files", "path", "npy")
    return folder


def copy(to, kind, suffix):
    to.mkdir(parents=True, exist_ok=True)
    for index in FEW:
        name = f"{kind}_{index}.{suffix}"
        shutil.copy(shared("barn", f"{kind}_files", name), to / name)


def refused(folder, index=None):
    """The error of reading a folder's world, or of opening it."""

    def read():
        opened = open_folder(folder)
        opened.read(opened.indices[0] if index is None else index)

    with pytest.raises(HlsdError) as caught:
        read()
    text = str(caught.value)
    assert "\n" not in text
    return text


def edit(file, old, new, count=1):
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, count))


@pytest.mark.parametrize("index", PUBLISHED)
def test_world_files_place_the_cylinders_that_the_grid_says(index):
    cylinders = read_world(shared("barn", "world_files", f"world_{index}.world"))
    grid = read_grid(shared("barn", "grid_files", f"grid_{index}.npy"))
    assert np.array_equal(cylinders, barn.placed(grid))
    assert np.array_equal(infer_grid(cylinders), grid)


def test_cylinders_stand_within_a_micrometre_of_the_world_file():
    file = shared("barn", "world_files", "world_120.world")
    head = file.read_text().split("<state ")[0]
    poses = [
        line.split(">")[1].split()[:2]
        for line in head.splitlines()
        if "000</pose" in line
    ]
    there = np.array(poses, dtype=float)
    grid = read_grid(shared("barn", "grid_files", "grid_120.npy"))
    ours = barn.cylinders_xy(grid)
    assert len(there) == len(ours) == 336
    gaps = np.linalg.norm(there[:, None] - ours[None], axis=2)
    assert gaps.min(axis=1).max() < 1e-6
    assert gaps.min(axis=0).max() < 1e-6


def test_grids_of_all_300_worlds_follow_from_their_cylinders():
    table = read_seed_table(resource("worlds") / "barn300.csv")
    for index in table.indices:
        grid = table.read(index).grid
        assert np.array_equal(infer_grid(barn.placed(grid)), grid), index


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), fill=st.floats(0.1, 0.9))
def test_an_inferred_grid_places_the_same_cylinders(seed, fill):
    rng = np.random.default_rng(seed)
    padded = np.pad(rng.random((30, 30)) < fill, 1)
    grids.smooth(padded, 1)
    grid = padded[1:-1, 1:-1]
    assert np.array_equal(barn.placed(infer_grid(barn.placed(grid))), barn.placed(grid))


def test_both_layouts_give_the_same_worlds(dataset, challenge):
    first, second = open_folder(dataset), open_folder(challenge)
    assert first.indices == second.indices == FEW
    for index in FEW:
        a, b = first.read(index), second.read(index)
        assert np.array_equal(a.grid, b.grid)
        assert np.array_equal(a.path, b.path)


def test_paths_may_stand_beside_and_either_geometry_may_be_absent(dataset, tmp_path):
    assert open_folder(dataset / "world_files").indices == FEW
    shutil.rmtree(dataset / "world_files")
    grids = open_folder(dataset).read(6).grid
    copy(dataset / "world_files", "world", "world")
    shutil.rmtree(dataset / "grid_files")
    assert np.array_equal(open_folder(dataset).read(6).grid, grids)


@pytest.mark.parametrize("name", ["world_6.world", "path_files/path_6.npy"])
def test_missing_file_is_named(challenge, name):
    (challenge / name).unlink()
    assert f"{name} is missing" in refused(challenge)


@pytest.mark.parametrize("kind", ["grid", "path", "world"])
def test_missing_file_of_the_dataset_is_named(dataset, kind):
    name = f"{kind}_6.{'world' if kind == 'world' else 'npy'}"
    (dataset / f"{kind}_files" / name).unlink()
    assert f"{name} is missing" in refused(dataset)


@pytest.mark.parametrize("keep", [0, 5, 100, 0.5])
@pytest.mark.parametrize("kind", ["grid", "path", "cspace", "world"])
def test_truncated_file_is_named(dataset, kind, keep):
    file = next((dataset / f"{kind}_files").glob(f"{kind}_0.*"))
    data = file.read_bytes()
    file.write_bytes(data[: int(keep * len(data)) if keep == 0.5 else keep])
    assert file.name in refused(dataset)


def test_pickles_archives_and_wrong_arrays_are_refused(dataset):
    file = dataset / "path_files" / "path_0.npy"
    for array in (
        np.array([{}], dtype=object),
        np.zeros((4, 2)),
        np.zeros((4, 3), dtype=int),
        np.zeros((1, 2), dtype=int),
        np.zeros((9, 2), dtype=int),
        np.full((9, 2), 30),
        np.array(3),
    ):
        np.save(file, array, allow_pickle=True)
        assert "path_0.npy" in refused(dataset)
    np.savez(dataset / "path_files" / "x.npz", a=np.zeros(3))
    shutil.move(dataset / "path_files" / "x.npz", file)
    assert "path_0.npy" in refused(dataset)
    grid = dataset / "grid_files" / "grid_0.npy"
    np.save(grid, np.full((30, 30), 2))
    assert refused(dataset)


def test_files_that_disagree_are_refused(dataset):
    shutil.copy(
        dataset / "grid_files" / "grid_6.npy", dataset / "grid_files" / "grid_0.npy"
    )
    text = refused(dataset)
    assert "disagree" in text
    assert "world_0.world" in text
    assert "grid_0.npy" in text


def test_cspace_of_another_world_is_refused(dataset):
    shutil.copy(
        dataset / "cspace_files" / "cspace_6.npy",
        dataset / "cspace_files" / "cspace_0.npy",
    )
    assert "cspace_0.npy is not the C-space" in refused(dataset)


def test_path_of_another_world_is_refused(challenge):
    paths = challenge / "path_files"
    shutil.copy(paths / "path_120.npy", paths / "path_0.npy")
    assert "path_0.npy does not fit its world" in refused(challenge)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<radius>0.075000<", "<radius>0.1<", "has radius 0.1"),
        ("<length>1</length>", "<length>2</length>", "length 2.0"),
        ("<length>1</length>", "<length>nan</length>", "where 1 numbers belong"),
        ("-0.225000 0.075000", "-0.235000 0.075000", "neither a free place"),
        ("-0.225000 0.075000", "-0.075000 0.075000", "neither a free place"),
        ("-0.225000 0.075000 0.000000", "-0.225000 0.075000 0.5", "upright"),
        ("-0.225000 0.075000 0.000000 0.0", "-0.225000 0.075 0 1.0", "upright"),
        ("-0.225000 0.075000", "-0.225000", "where 6 numbers belong"),
        ("<world name='default'>", "<world><include/>", "<include>"),
        ("<sdf version='1.6'>", "<sdf><a/>", None),
        (
            "<static>1</static>\n      <pose",
            "<static>0</static>\n      <pose",
            "static",
        ),
    ],
)
def test_other_geometry_is_refused(challenge, old, new, words):
    file = challenge / "world_0.world"
    edit(file, old, new)
    if words is None:
        assert open_folder(challenge).read(0) is not None
    else:
        text = refused(challenge)
        assert words in text
        assert "world_0.world" in text


def test_box_and_missing_start_box_are_refused(challenge):
    file = challenge / "world_0.world"
    text = file.read_text()
    head, first, rest = text.split("<model name='unit_cylinder_", 2)
    without = head + "<model name='unit_cylinder_" + rest
    file.write_text(without)
    assert "start box" in refused(challenge)
    a, b = first.index("<cylinder>"), first.index("</cylinder>")
    box = first[:a] + "<box><size>1 1 1</size></box>" + first[b + len("</cylinder>") :]
    file.write_text("<model name='unit_cylinder_".join((head, box, rest)))
    assert "is a box" in refused(challenge)


def test_enclosed_cylinder_fits_no_grid(challenge, monkeypatch):
    cylinders = np.zeros((30, 30), dtype=bool)
    cylinders[[0, -1]] = True
    cylinders[10:13, 10:13] = True
    module = "hlsd.data.barn_files.read_world"
    monkeypatch.setattr(module, lambda file: cylinders)
    assert "no BARN grid places these cylinders" in refused(challenge)


def test_folders_without_worlds_or_paths_are_refused(tmp_path, challenge):
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "holds no BARN worlds" in refused(empty)
    shutil.rmtree(challenge / "path_files")
    assert "has no paths" in refused(challenge)
