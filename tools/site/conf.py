"""The documentation as a site, by Sphinx: `make docs` builds it into build/site."""

import sys
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[2])]

import site_parts  # noqa: E402

from hlsd.core.version import __version__  # noqa: E402

project = "hlsd"
author = "The hlsd authors"
project_copyright = author
version = release = __version__

root_doc = site_parts.ROOT_PAGE
pages = [page for part in site_parts.NAVIGATION.values() for page in part]
include_patterns = [f"{page}.*" for page in [root_doc, *pages]]
exclude_patterns = ["**/*.py", "**/*.png", "**/*.csv"]
source_suffix = {".md": "markdown", ".ipynb": "markdown"}
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]

# Anchors as GitHub makes them; a page's first line is its heading.
myst_heading_anchors = 6
myst_links_external_new_tab = False
# Blocks of TOML, YAML and JSON that show a part of a file need no lexer's consent.
suppress_warnings = ["misc.highlighting_failure"]

autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_member_order = "bysource"
autodoc_default_options = {"undoc-members": False}
default_role = "code"
napoleon_use_ivar = True
napoleon_custom_sections = [("Members", "params_style")]
add_module_names = False
python_use_unqualified_type_names = True

html_theme = "furo"
html_title = f"hlsd {__version__}"
html_copy_source = False
html_show_sphinx = False
html_static_path: list[str] = []
pygments_style = "friendly"
pygments_dark_style = "native"

_ENTRY = """\
<!doctype html>
<meta charset="utf-8">
<title>hlsd</title>
<meta http-equiv="refresh" content="0; url=README.html">
<a href="README.html">hlsd</a>
"""


def _read(app: Any, name: str, source: list[str]) -> None:
    source[0] = site_parts.page_text(name, source[0])


def _documented(
    app: Any, what: str, name: str, thing: object, options: object, lines: list[str]
) -> None:
    # Napoleon takes what stands before a colon in the first line for a type.
    if what in {"attribute", "data", "property"}:
        lines.insert(0, "")


def _finished(app: Any, error: Exception | None) -> None:
    if error is None:
        (Path(app.outdir) / "index.html").write_text(_ENTRY, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Connect what the site adds to its pages; pages may be read in parallel."""
    app.connect("source-read", _read)
    app.connect("build-finished", _finished)
    app.connect("autodoc-process-docstring", _documented, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
