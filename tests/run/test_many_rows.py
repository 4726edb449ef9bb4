"""What a run of many worlds costs its parent: nothing that grows but rows, packed."""

import gc
import json
import tracemalloc

import numpy as np
import pytest

from hlsd.core.errors import HlsdError
from hlsd.core.executor import tell
from hlsd.core.files import writing_atomic
from hlsd.data.barn import BarnMap
from hlsd.data.worlds import Suite
from hlsd.run.crew import Crew
from hlsd.run.pieces import Pieces, digest
from hlsd.run.row import COLUMNS
from hlsd.run.rows import Rows
from hlsd.run.shard import Share
from hlsd.run.trajectory import ARCHIVE, pack, read_archive
from hlsd.run.work import Done, Task

ROW = {name: f"{name[:3]}{number}" for number, name in enumerate(COLUMNS)}


class Counted(int):
    """A number that counts how often it is compared."""

    compared = 0

    def __eq__(self, other):
        Counted.compared += 1
        return int(self) == int(other)

    __hash__ = int.__hash__


@pytest.fixture(autouse=True)
def counting():
    Counted.compared = 0


def peak_of(work):
    """Bytes that Python holds at most meanwhile, beside what it held before."""
    gc.collect()
    tracemalloc.start()
    try:
        result = work()
        return tracemalloc.get_traced_memory()[1], result
    finally:
        tracemalloc.stop()


# --- rows ---------------------------------------------------------------------------


def test_rows_come_back_as_they_were_taken():
    rows = Rows()
    odd = {"b": 'a,"\n\x00\udc80ü', "a": ""}
    rows["p", 3, 0] = ROW
    rows["p", 1, 0] = odd
    rows["p", 3, 1] = dict(ROW)
    assert rows == {("p", 3, 0): ROW, ("p", 1, 0): odd, ("p", 3, 1): ROW}
    assert list(rows["p", 1, 0]) == ["b", "a"]
    rows["p", 3, 0]["planner"] = "changed"
    assert rows["p", 3, 0] == ROW
    del rows["p", 3, 0]
    assert ("p", 3, 0) not in rows
    assert len(rows) == 2
    with pytest.raises(KeyError):
        rows["p", 3, 0]


def test_a_row_takes_a_fraction_of_its_dict():
    text = json.dumps(ROW)

    def many(into):
        for world in range(500):
            into["p", world, 0] = json.loads(text)
        return into

    packed, _ = peak_of(lambda: many(Rows()))
    plain, _ = peak_of(lambda: many({}))
    assert packed < 500 * (len(text) + 400)
    assert packed < plain / 4


def test_what_tasks_said_is_forgotten_with_their_results():
    class Working:
        def __call__(self, task):
            done = Done(rows=[{"planner": "forgotten", "trial": "0"}])
            tell(done)
            return done

    class Telling:
        def run(self, function, tasks, *, told=None):
            for number, task in enumerate(tasks):
                done = function(task)
                told(number, done)
                yield number, done

    tasks = [Task(world, (("p", 0),)) for world in range(30)]
    most, count = 0, 0
    with Crew(Telling(), ()) as crew:
        for _ in crew.drive(Working(), tasks):
            held = (each for each in gc.get_objects() if type(each) is Done)
            # Other tests may keep theirs.
            most = max(most, sum("forgotten" in str(each.rows) for each in held))
            count += 1
    assert count == 30
    assert most <= 4


# --- worlds -------------------------------------------------------------------------


class Reader:
    """Worlds whose indices count how often they are asked for and compared."""

    def __init__(self, count):
        self.asked, self._count = 0, count

    @property
    def indices(self):
        self.asked += 1
        return tuple(map(Counted, range(self._count)))

    def read(self, index):
        return BarnMap(np.zeros((30, 30), bool), np.zeros((2, 2), np.int64))

    def digests(self, index):
        return "0" * 64, "1" * 64


def test_a_world_is_found_without_a_look_at_the_others():
    reader = Reader(2000)
    suite = Suite("many", "1", "s", reader)
    assert suite.digest == Suite("many", "1", "s", Reader(2000)).digest
    assert sum(1 for _ in suite) == 2000
    assert [suite[index].index for index in range(0, 2000, 5)][-1] == 1995
    with pytest.raises(HlsdError, match="has no world 2000: it has worlds 0 to 1999"):
        suite[2000]
    assert reader.asked == 1
    assert Counted.compared < 3 * 2000 + 2000


def test_a_run_knows_its_episodes_without_a_look_at_all():
    worlds = tuple(map(Counted, range(2000)))
    share = Share(("p",), worlds, 2)
    assert all(share.has("p", world, 1) for world in range(2000))
    assert not share.has("p", 2000, 0)
    assert not share.has("p", 0, 2)
    assert Counted.compared <= 2 * 2001


# --- trajectories -------------------------------------------------------------------


def stored(folder, worlds, size):
    """Pieces of two planners' blocks: digests by episode, and the order wanted."""
    pieces = Pieces(folder)
    rng = np.random.default_rng(2)
    digests = {}
    for world in worlds:
        blocks = {(name, world, 0): rng.bytes(size) for name in ("b", "a")}
        pieces.keep(blocks)
        digests |= {key: digest(block) for key, block in blocks.items()}
    return pieces, digests, sorted(digests, key=lambda key: ("ba".index(key[0]), *key))


def test_the_archive_is_written_block_by_block_to_the_same_bytes(tmp_path):
    size, worlds = 100_000, range(100, 0, -1)
    pieces, digests, order = stored(tmp_path, worlds, size)
    peak, _ = peak_of(lambda: pieces.write_archive(digests, order))
    assert peak < 10 * size
    peak, found = peak_of(lambda: pieces.find(digests))
    assert peak < 10 * size
    assert found == digests.keys()
    data = (tmp_path / ARCHIVE).read_bytes()
    archive = read_archive(tmp_path / ARCHIVE)
    assert list(archive) == order
    assert data == pack(dict(archive), order)
    pieces.write_archive(digests, order)  # once more, now beside the archive
    pieces.remove()
    pieces.write_archive(digests, order)  # and from it alone
    assert (tmp_path / ARCHIVE).read_bytes() == data


def test_a_block_that_was_damaged_leaves_the_archive_as_it_was(tmp_path):
    pieces, digests, order = stored(tmp_path, range(4), 1000)
    pieces.write_archive(digests, order)
    before = (tmp_path / ARCHIVE).read_bytes()
    (tmp_path / "trajectories" / "2.zip").unlink()
    pieces.write_archive(digests, order)
    wrong = digests | {("a", 2, 0): digest(b"other")}
    assert pieces.find(wrong) == wrong.keys() - {("a", 2, 0)}
    with pytest.raises(HlsdError, match="were damaged while its run went on"):
        pieces.write_archive(wrong, order)
    fewer = {key: value for key, value in digests.items() if key[1] > 0}
    with pytest.raises(HlsdError, match="holds 8 runs, more than the 6"):
        pieces.write_archive(fewer, order)
    assert (tmp_path / ARCHIVE).read_bytes() == before
    assert {file.name for file in tmp_path.iterdir()} == {ARCHIVE, "trajectories"}


def test_a_file_in_parts_is_there_whole_or_not_at_all(tmp_path):
    file = tmp_path / "parts"

    def write(fail):
        with writing_atomic(file) as draft:
            draft.write(b"one")
            assert not file.exists()
            if fail:
                raise KeyError
            draft.write(b"two")

    with pytest.raises(KeyError):
        write(fail=True)
    assert list(tmp_path.iterdir()) == []
    write(fail=False)
    assert file.read_bytes() == b"onetwo"
    with pytest.raises(HlsdError, match="cannot write"), writing_atomic(file / "x"):
        pass
