"""Pictures of a world in three dimensions, by MuJoCo's renderer, with no display.

EGL draws where a driver for it is installed, on a graphics card or without one; OSMesa
draws in software alone.
"""

import contextlib
import os
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt

from hlsd.core.errors import HlsdError
from hlsd.core.text import error_text
from hlsd.core.types import FloatArray

Picture = npt.NDArray[np.uint8]
"""Rows of pixels from the top, red, green and blue, ``(height, width, 3)``."""

MOST_PIXELS = 3840
"""Along either side."""
_MOST_GEOMS = 20_000


class View(NamedTuple):
    """Where a picture is taken from.

    Attributes:
        look_at: A point in the world, ``(3,)`` [m].
        distance_m: From there to the camera.
        azimuth_deg: Direction in which it looks, anticlockwise from the world's x axis.
        elevation_deg: Above the horizon; -90 looks straight down.
    """

    look_at: FloatArray
    distance_m: float
    azimuth_deg: float
    elevation_deg: float


class Painter:
    """Draws the states of one model.

    Attributes:
        width: Of its pictures [pixels].
        height: Of its pictures [pixels].
    """

    def __init__(
        self, model: mujoco.MjModel, width: int, height: int, current: Any
    ) -> None:
        """Set up a picture of a size; `painter` also takes it down again."""
        self.width, self.height = width, height
        self._model, self._current = model, current
        self._scene = mujoco.MjvScene(model, maxgeom=_MOST_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        self._options = mujoco.MjvOption()
        # What is seen of the robot stands in group 2, what collides in group 3.
        self._options.geomgroup[3] = 0
        self._options.sitegroup[:] = 0
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150)
        mujoco.mjr_resizeOffscreen(width, height, self._context)
        mujoco.mjr_setBuffer(int(mujoco.mjtFramebuffer.mjFB_OFFSCREEN), self._context)

    def draw(
        self,
        data: mujoco.MjData,
        view: View | str,
        add: Callable[[mujoco.MjvScene], None] | None = None,
    ) -> Picture:
        """A picture of a state.

        Args:
            data: The state, after ``mj_forward`` or ``mj_kinematics``.
            view: Where from, or the name of one of the model's cameras.
            add: Puts marks into the scene; see `mark_balls` and `mark_line`.
        """
        self._current.make_current()
        camera = mujoco.MjvCamera()
        if isinstance(view, str):
            camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
            camera.fixedcamid = self._model.camera(view).id
        else:
            camera.lookat[:] = view.look_at
            camera.distance = view.distance_m
            camera.azimuth, camera.elevation = view.azimuth_deg, view.elevation_deg
        mujoco.mjv_updateScene(
            self._model,
            data,
            self._options,
            None,
            camera,
            int(mujoco.mjtCatBit.mjCAT_ALL),
            self._scene,
        )
        if add is not None:
            add(self._scene)
        area = mujoco.MjrRect(0, 0, self.width, self.height)
        picture = np.empty((self.height, self.width, 3), dtype=np.uint8)
        mujoco.mjr_render(area, self._scene, self._context)
        mujoco.mjr_readPixels(picture, None, area, self._context)
        return picture[::-1]

    def close(self) -> None:
        """Free what the graphics driver holds."""
        self._current.make_current()
        self._context.free()


@contextlib.contextmanager
def painter(model: mujoco.MjModel, width: int, height: int) -> Iterator[Painter]:
    """A `Painter`, for as long as the block lasts.

    Args:
        model: What to draw.
        width: Of the pictures [pixels].
        height: Likewise.

    Raises:
        HlsdError: A size that cannot be, or nothing here can draw.
    """
    for name, value in (("width", width), ("height", height)):
        if not 16 <= value <= MOST_PIXELS:
            raise HlsdError(
                f"a {name} of {value} pixels: give 16 to {MOST_PIXELS}", argument=name
            )
    context = _context(width, height)
    try:
        held = Painter(model, width, height, context)
        try:
            yield held
        finally:
            held.close()
    finally:
        context.free()


def mark_balls(
    scene: mujoco.MjvScene, points: FloatArray, radius_m: float, rgba: FloatArray
) -> None:
    """Put balls into a scene, as many as it has room for.

    Args:
        scene: Changed.
        points: Their middles, ``(n, 3)`` [m].
        radius_m: Of each.
        rgba: Red, green, blue, opacity, ``(4,)``, 0 to 1.
    """
    size, turn = np.full(3, radius_m), np.eye(3).ravel()
    for point in points[: scene.maxgeom - scene.ngeom]:
        _begin(scene, mujoco.mjtGeom.mjGEOM_SPHERE, size, point, turn, rgba)


def mark_line(
    scene: mujoco.MjvScene, points: FloatArray, radius_m: float, rgba: FloatArray
) -> None:
    """Put a line of rods from point to point into a scene.

    Args:
        scene: Changed.
        points: ``(n, 3)`` [m].
        radius_m: Of the rods.
        rgba: As in `mark_balls`.
    """
    room = scene.maxgeom - scene.ngeom
    kind = mujoco.mjtGeom.mjGEOM_CAPSULE
    for one, other in zip(points[:-1][:room], points[1:][:room], strict=True):
        geom = _begin(scene, kind, np.zeros(3), np.zeros(3), np.zeros(9), rgba)
        mujoco.mjv_connector(geom, int(kind), radius_m, one, other)


def mark_disc(
    scene: mujoco.MjvScene, middle: FloatArray, radius_m: float, rgba: FloatArray
) -> None:
    """Lay a flat disc into a scene; arguments as in `mark_balls`, middle ``(3,)``."""
    if scene.ngeom < scene.maxgeom:
        size, kind = np.array((radius_m, 0.004, 0.0)), mujoco.mjtGeom.mjGEOM_CYLINDER
        _begin(scene, kind, size, middle, np.eye(3).ravel(), rgba)


def _begin(
    scene: mujoco.MjvScene,
    kind: mujoco.mjtGeom,
    size: FloatArray,
    place: FloatArray,
    turn: FloatArray,
    rgba: FloatArray,
) -> Any:
    geom = scene.geoms[scene.ngeom]
    colour = np.asarray(rgba, dtype=np.float32)
    mujoco.mjv_initGeom(geom, int(kind), size, place, turn, colour)
    geom.category = int(mujoco.mjtCatBit.mjCAT_DECOR)
    scene.ngeom += 1
    return geom


def _context(width: int, height: int) -> Any:
    """A current graphics context without a window; ``MUJOCO_GL`` may name the kind.

    Raises:
        HlsdError: None can be made.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower()
    kinds = {"egl": _egl, "osmesa": _osmesa}
    reasons = []
    for name in [wanted] if wanted in kinds else kinds:
        try:
            context = kinds[name](width, height)
            context.make_current()
            return context
        except Exception as error:  # whatever the driver or its binding raises
            reasons.append(f"{name}: {error_text(error)}")
    raise HlsdError(
        f"nothing here can draw without a display ({'; '.join(reasons)}): install EGL "
        "with a driver (Debian and Ubuntu: apt install libegl1 libgl1-mesa-dri) or "
        "OSMesa (apt install libosmesa6)"
    )


def require_context() -> None:
    """See that something can be drawn here; of the kind ``MUJOCO_GL``, if it is set.

    A broken driver may take the process along.

    Raises:
        HlsdError: Nothing can.
    """
    _context(64, 64).free()


def _egl(width: int, height: int) -> Any:
    from mujoco.egl import GLContext

    return GLContext(width, height)


def _osmesa(width: int, height: int) -> Any:
    from mujoco.osmesa import GLContext

    return GLContext(width, height)
