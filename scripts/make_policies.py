"""Make the shipped policies again from their recorded commands, and compare.

    python scripts/make_policies.py            all of them; a difference is an error
    python scripts/make_policies.py hlsd10     only these
    python scripts/make_policies.py --accept   write policies and digests

`hlsd/learning/policies/recipes.toml` holds, for each policy, the two commands and the
digests of what they make.
"""

import argparse
import hashlib
import shlex
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

POLICIES = Path(__file__).resolve().parents[1] / "hlsd" / "learning" / "policies"
RECIPES = POLICIES / "recipes.toml"
HEADER = """\
# How each shipped policy was made: two commands, and the SHA-256 of what they write.
# `make policies` runs them again and compares. Training promises the same bytes on the
# same kind of processor with the same version of torch; the motion log promises more.
"""


def main() -> int:
    """Run the recipes; 0 if all digests agree."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("planners", nargs="*", help="all if left out")
    parser.add_argument("--accept", action="store_true", help="write what was made")
    arguments = parser.parse_args()
    recipes = tomllib.loads(RECIPES.read_text(encoding="utf-8"))
    differing = []
    for planner in arguments.planners or list(recipes):
        digests, policy = make(recipes[planner])
        same = digests.items() <= recipes[planner].items()
        print(f"{planner}: {'same bytes' if same else 'differs'}", flush=True)
        if same:
            continue
        differing.append(planner)
        if arguments.accept:
            (POLICIES / f"{planner}.npz").write_bytes(policy)
            recipes[planner].update(digests)
            RECIPES.write_text(render(recipes), encoding="utf-8")
    return 1 if differing and not arguments.accept else 0


def make(recipe: dict[str, str]) -> tuple[dict[str, str], bytes]:
    """Run a recipe's commands in an empty folder; digests, and the policy itself."""
    with tempfile.TemporaryDirectory() as folder:
        for command in (recipe["collect"], recipe["train"]):
            print(f"$ {command}", flush=True)
            program, *rest = shlex.split(command)
            assert program == "hlsd"
            subprocess.run(
                [sys.executable, "-m", "hlsd", *rest], cwd=folder, check=True
            )
        log, policy = (
            next(Path(folder).glob(name)) for name in ("*.log.npz", "p*.npz")
        )
        digests = {
            "log_sha256": hashlib.sha256(log.read_bytes()).hexdigest(),
            "policy_sha256": hashlib.sha256(policy.read_bytes()).hexdigest(),
        }
        return digests, policy.read_bytes()


def render(recipes: dict[str, dict[str, str]]) -> str:
    """The recipes as TOML."""
    blocks = [HEADER]
    for planner, recipe in recipes.items():
        lines = [f'{key} = "{value}"' for key, value in recipe.items()]
        blocks.append("\n".join([f"[{planner}]", *lines]) + "\n")
    return "\n".join(blocks)


if __name__ == "__main__":
    sys.exit(main())
