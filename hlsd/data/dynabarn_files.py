"""DynaBARN's worlds as the BARN Challenge publishes them: SDF files and plug-ins.

A checkout of Daffan/the-barn-challenge has ``jackal_helper/worlds/DynaBARN`` with
``world_N.world`` and ``jackal_helper/plugins`` with a shared library for each obstacle.
Standing obstacles are static models of one box or cylinder each; a moving one is a
cylinder with a plug-in, which holds its key frames (`hlsd.data.plugin_keys`). All is
read-only.
"""

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.reading import shown
from hlsd.core.text import one_line
from hlsd.data.arena import DYNABARN, ArenaMap, fault
from hlsd.data.dynabarn import GOAL_XY_M, START
from hlsd.data.plugin_keys import read_plugin
from hlsd.data.sdf import (
    STATIC,
    is_ground,
    is_harmless,
    is_zero,
    name_of,
    numbers_of,
    read_sdf,
    shapes_of,
)
from hlsd.data.shapes import Mover, Shapes
from hlsd.data.tracks import Track


class PluggedMover(NamedTuple):
    """A moving obstacle as a world's file has it.

    Attributes:
        name: Of its model.
        plugin: File name of its plug-in.
        radius_m: Of the cylinder [m].
        top_m: Height of its top while its plug-in keeps it at z = 0 [m].
    """

    name: str
    plugin: str
    radius_m: float
    top_m: float


@dataclass(frozen=True, slots=True)
class DynabarnFolder:
    """A checkout's worlds, read when they are asked for.

    Attributes:
        folder: Of ``world_N.world``.
        plugins: Of the plug-ins.
        indices: N of every world, ascending.
    """

    folder: Path
    plugins: Path
    indices: tuple[int, ...]
    _tracks: dict[str, Track] = field(default_factory=dict)

    def read(self, index: int) -> ArenaMap:
        """One world.

        Raises:
            HlsdError: A file of it is missing or damaged, or says what is not read.
        """
        file = self.folder / f"world_{index}.world"
        shapes, plugged = read_dynabarn_world(file)
        movers = tuple(
            Mover(self._track(each), radius_m=each.radius_m, top_m=each.top_m)
            for each in plugged
        )
        made = ArenaMap(START, GOAL_XY_M, shapes, movers, DYNABARN)
        wrong = fault(made)
        if wrong is not None:
            raise HlsdError(f"{shown(file)} is not a world that is read: {wrong}")
        return made

    def digests(self, index: int) -> tuple[str, str]:
        """SHA-256 of a world's two parts.

        Raises:
            HlsdError: As `read`.
        """
        made = self.read(index)
        return made.grid_sha256(), made.path_sha256()

    def _track(self, mover: PluggedMover) -> Track:
        """Of a mover; worlds share plug-ins, and each is read once."""
        if mover.plugin not in self._tracks:
            self._tracks[mover.plugin] = read_plugin(self.plugins / mover.plugin)
        return self._tracks[mover.plugin]


def find_dynabarn(folder: Path) -> DynabarnFolder | None:
    """DynaBARN's worlds in a folder; None if it holds none.

    Args:
        folder: A checkout of the Challenge, its ``jackal_helper``, or the folder of the
            worlds, beside which, or in which, the plug-ins are.

    Raises:
        HlsdError: There are such worlds without a folder of plug-ins, or a folder
            cannot be read.
    """
    for inner in _INNER:
        worlds = folder / inner
        indices = _indices(worlds)
        if not indices or not _is_plugged(worlds / f"world_{indices[0]}.world"):
            continue
        here = worlds.resolve()
        places = [
            place / "plugins" for place in (here, here.parent, here.parent.parent)
        ]
        for place in (*places, here):
            if place.is_dir() and any(place.glob("*.so")):
                return DynabarnFolder(worlds, place, indices)
        raise HlsdError(
            f"{shown(worlds)} holds worlds of DynaBARN, but there are no plug-ins: "
            "expected *.so in a folder 'plugins' in it, beside it or beside its parent"
        )
    return None


def read_dynabarn_world(file: Path) -> tuple[Shapes, tuple[PluggedMover, ...]]:
    """What stands and what moves in a ``.world`` file of DynaBARN.

    Raises:
        HlsdError: The file is missing or damaged, or has other things than boxes and
            upright cylinders on the ground.
    """
    cylinders, boxes, movers = [], [], []
    for element in read_sdf(file):
        if element.tag in ("actor", "population", "road"):
            raise HlsdError(f"{shown(file)}: cannot import <{element.tag}>: {_ONLY}")
        if element.tag == "plugin":
            raise HlsdError(f"{shown(file)}: the world itself has a plug-in: {_ONLY}")
        if element.tag == "include" and not is_harmless(element):
            uri = one_line(element.findtext("uri", "").strip(), 100)
            raise HlsdError(f"{shown(file)}: cannot import <include> {uri!r}: {_ONLY}")
        if element.tag != "model" or is_ground(element):
            continue
        plugin = _plugin(file, element)
        shape, pose = _standing(file, element, moved=plugin is not None)
        name = name_of(element)
        sizes = _sizes(file, name, shape)
        height = sizes[-1]
        top = pose[2] + height / 2
        if min(sizes) <= 0.0 or pose[2] - height / 2 > _TOLERANCE_M or top <= 0.0:
            raise HlsdError(f"{shown(file)}: {name} does not stand on the ground")
        if plugin is not None:
            if shape.tag != "cylinder":
                raise HlsdError(
                    f"{shown(file)}: {name} moves and is a {shape.tag}: {_ONLY}"
                )
            movers.append(PluggedMover(name, plugin, sizes[0], top))
        elif shape.tag == "cylinder":
            cylinders.append((*pose[:2], sizes[0], top))
        else:
            boxes.append((*pose[:2], pose[5], sizes[0] / 2, sizes[1] / 2, top))
    return Shapes(np.array(cylinders), np.array(boxes)), tuple(movers)


_INNER = ("jackal_helper/worlds/DynaBARN", "worlds/DynaBARN", "DynaBARN", ".")
"""Where the worlds are, from what is named."""
_ONLY = (
    "DynaBARN's worlds have boxes and upright cylinders on the ground, each a static "
    "model of one shape, and cylinders may have one plug-in that moves them"
)
_TOLERANCE_M = 1e-6
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}\.so")
_WORLD = re.compile(r"world_(0|[1-9][0-9]{0,8})\.world")


def _indices(folder: Path) -> tuple[int, ...]:
    try:
        if not folder.is_dir():
            return ()
        matches = (_WORLD.fullmatch(entry.name) for entry in folder.iterdir())
        return tuple(sorted(int(match[1]) for match in matches if match))
    except OSError as error:
        raise HlsdError(
            f"cannot read folder {shown(folder)}: {error.strerror}"
        ) from error


def _is_plugged(file: Path) -> bool:
    """Whether a model of a world has a plug-in; False where it is no world at all."""
    try:
        world = read_sdf(file)
    except HlsdError:  # the reader of the other kind of worlds says what is wrong
        return False
    return any(model.find("plugin") is not None for model in world.iter("model"))


def _plugin(file: Path, model: ElementTree.Element) -> str | None:
    """File name of a model's plug-in; None if it has none."""
    plugins = list(model.iter("plugin"))
    if not plugins:
        return None
    name = plugins[0].get("filename", "")
    if len(plugins) > 1 or _NAME.fullmatch(name) is None:
        raise HlsdError(
            f"{shown(file)}: {name_of(model)} has {len(plugins)} plug-ins, the first "
            f"{one_line(name, 60)!r}: wanted is one, the name of a file like "
            "'easylibobs_0.so'"
        )
    return name


def _standing(
    file: Path, model: ElementTree.Element, *, moved: bool
) -> tuple[ElementTree.Element, list[float]]:
    """The one shape of a static model, and the pose of its centre.

    Args:
        file: Where it is from, for the error's text.
        model: The model.
        moved: Whether a plug-in places it: then its own pose does not count.
    """
    name = name_of(model)
    links = model.findall("link")
    collisions = [found for link in links for found in link.findall("collision")]
    shapes = shapes_of(model)
    nested = [found for tag in ("model", "include") for found in model.iter(tag)]
    one = len(links) == len(collisions) == len(shapes) == len(nested) == 1
    if not one or shapes[0].tag not in ("box", "cylinder"):
        raise HlsdError(f"{shown(file)}: cannot import {name}: {_ONLY}")
    if model.findtext("static", "").strip() not in STATIC:
        raise HlsdError(f"{shown(file)}: {name} is not static: {_ONLY}")
    for offset in (*links, *collisions):
        text = offset.findtext("pose")
        if text is not None and not is_zero(numbers_of(file, name, text, 6)):
            raise HlsdError(
                f"{shown(file)}: {name} has a link or shape off its own centre"
            )
    pose = numbers_of(file, name, model.findtext("pose", "0 0 0 0 0 0"), 6)
    if moved:
        return shapes[0], [0.0] * 6
    if not is_zero(pose[3:5]):
        raise HlsdError(f"{shown(file)}: {name} is tilted: {_ONLY}")
    return shapes[0], pose


def _sizes(file: Path, name: str, shape: ElementTree.Element) -> list[float]:
    """Radius and height of a cylinder, or a box's extents [m]."""
    if shape.tag == "box":
        return numbers_of(file, name, shape.findtext("size"), 3)
    texts = (shape.findtext("radius"), shape.findtext("length"))
    return [numbers_of(file, name, text, 1)[0] for text in texts]
