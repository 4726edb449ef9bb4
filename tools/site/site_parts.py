"""What the site has beyond its pages: their order, notebooks, and the API's docstrings.

Pages are Markdown as GitHub shows it, and stay where they are in the repository; so all
links between them lead where they lead on GitHub. Two things are made for the site: the
names on docs/api.md get their docstrings, and a notebook becomes a page.
"""

import json
import posixpath
import re

ROOT_PAGE = "README"
API_PAGE = "docs/api"

# The navigation: headings, and under each the pages in order, as paths without suffix.
NAVIGATION: dict[str, tuple[str, ...]] = {
    "Start here": ("docs/start", "examples/first_look", "docs/troubleshooting"),
    "Your planner": (
        "docs/how-to/planner",
        "docs/planners",
        "docs/observation",
        "docs/how-to/debug",
        "docs/configuration",
        "docs/external",
        "examples/ros2_bridge/README",
    ),
    "Run and compare": (
        "docs/suites",
        "docs/dynabarn",
        "docs/columns",
        "docs/report",
        "docs/seeing",
        "docs/statistics",
        "docs/until-decided",
        "docs/causes",
        "docs/perturbations",
        "docs/sweeps",
        "docs/scale",
        "docs/gym",
        "docs/policies",
        "docs/hlsd20",
        "docs/checkpoints",
        "docs/barn-teams",
        "docs/across-papers",
        "docs/mpc-and-teb",
    ),
    "Add your own": (
        "docs/how-to/protocol",
        "docs/how-to/robot",
        "docs/how-to/suite",
        "docs/how-to/metric",
        "docs/how-to/perturbation",
    ),
    "Evidence": (
        "docs/reading-the-paper",
        "docs/reproducing-the-paper",
        "docs/agreement-with-gazebo",
        "docs/promises",
        "assets/README",
        "worlds/README",
    ),
    "Reference": (
        "docs/cli",
        "docs/json",
        "docs/python",
        "docs/api",
        "docs/metrics",
        "benchmarks/README",
        "CHANGELOG",
        "CONTRIBUTING",
    ),
}

_NAME = re.compile(r"^- `hlsd\.(\w+)`.*$", re.MULTILINE)


def page_text(name: str, text: str) -> str:
    """A page's Markdown for the site.

    Args:
        name: Path of the page, without suffix.
        text: As in the repository.
    """
    if name == ROOT_PAGE:
        return text + navigation()
    if name == API_PAGE:
        return with_docstrings(text)
    if text.startswith("{") and name.startswith("examples/"):
        return notebook_text(text)
    return text


def navigation() -> str:
    """The table of contents, which the root page holds, unseen."""
    blocks = []
    for caption, pages in NAVIGATION.items():
        lines = "\n".join(f"/{page}" for page in pages)
        blocks.append(
            f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{lines}\n```\n"
        )
    return "".join(blocks)


def with_docstrings(text: str) -> str:
    """The page of the API with the docstring of each name in place of its line."""

    def documented(match: re.Match[str]) -> str:
        name = match[1]
        kind, members = (
            ("class", "\n   :members:") if name[0].isupper() else ("function", "")
        )
        directive = f".. auto{kind}:: hlsd.{name}{members}"
        return f"\n```{{eval-rst}}\n{directive}\n```\n"

    return _NAME.sub(documented, text)


def notebook_text(text: str) -> str:
    """A notebook as Markdown: its texts, its code, and what its cells printed."""
    parts = []
    for cell in json.loads(text)["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            data = output.get("data", {"text/plain": output.get("text", "")})
            if "image/png" in data:
                picture = "".join("".join(data["image/png"]).split())
                parts.append(f"![what the cell drew](data:image/png;base64,{picture})")
            elif plain := "".join(data.get("text/plain", "")).rstrip():
                parts.append(f"```text\n{plain}\n```")
    return "\n\n".join(parts) + "\n"


def target_of(page: str, link: str) -> str | None:
    """The path in the repository that a relative link leads to; None for others.

    Args:
        page: Path of the page.
        link: As it stands there.
    """
    path = link.partition("#")[0]
    if not path or re.match(r"[a-z]+:", link):
        return None
    return posixpath.normpath(posixpath.join(posixpath.dirname(page), path))
