"""Load MJCF files in the MuJoCo that is here, and in mujoco-warp where it is here.

    python scripts/load_mjcf.py world.xml ...

It needs no hlsd. Exit code 1 where one does not load, MuJoCo warns, or the robot does
not drive.
"""

import contextlib
import importlib
import sys
import warnings
from pathlib import Path

import mujoco


def fault(file: str) -> str:
    """What is wrong with a file; empty where it loads and its robot drives."""
    said: list[str] = []
    mujoco.set_mju_user_warning(said.append)
    try:
        model = mujoco.MjModel.from_xml_path(file)
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        before = data.qpos[:2].copy()
        data.ctrl[:] = 4.0
        mujoco.mj_step(model, data, nstep=100)
        driven = float(abs(data.qpos[:2] - before).max())
        if driven < 0.05:
            said.append(f"the robot drove {driven} m")
        with contextlib.suppress(ModuleNotFoundError):
            importlib.import_module("mujoco_warp").put_model(model)
    except (ValueError, NotImplementedError, Warning) as error:
        said.append(str(error))
    finally:
        mujoco.set_mju_user_warning(None)
    return "; ".join(said)


def main() -> int:
    """Load all; the exit code."""
    # mujoco-warp and Warp are not ours: what they warn of as they load says nothing.
    with contextlib.suppress(ModuleNotFoundError), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        importlib.import_module("mujoco_warp")
    warnings.simplefilter("error")
    wrong = {file: said for file in sys.argv[1:] if (said := fault(file))}
    taken = len(sys.argv) - 1 - len(wrong)
    here = "mujoco-warp and " if "mujoco_warp" in sys.modules else ""
    print(f"{here}MuJoCo {mujoco.__version__}: {taken} files load")
    for file, said in wrong.items():
        print(f"{Path(file).name}: {said}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
