"""Sphinx configuration. The reference pages are generated from the code before each build."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
for folder in ("pipeline", "store", "workflows", "docs"):
    sys.path.insert(0, str(HERE.parent / folder))

from mathml import add_mathml  # noqa: E402 - after the path
from reference_pages import write_reference  # noqa: E402

from softclose import __version__  # noqa: E402

write_reference(HERE / "reference")

project = "Softclose"
author = "The Softclose founders"
copyright = "2026, The Softclose founders"
version = release = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc", "sphinx_click"]
numpydoc_show_class_members = False
default_role = "literal"
autodoc_default_options = {"imported-members": True, "undoc-members": False}
autodoc_member_order = "bysource"
autodoc_typehints = "none"
myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]
suppress_warnings: list[str] = []

html_theme = "furo"
html_title = "Softclose"
html_static_path = ["_static"]
html_css_files = ["math.css"]
html_theme_options = {"source_directory": "docs/"}
pygments_style = "friendly"
pygments_dark_style = "monokai"


def setup(app):
    """Equations as MathML: no network and no script when a page is read."""
    from pygments.lexers.special import TextLexer

    add_mathml(app)
    app.add_lexer("csv", TextLexer)
    app.connect("sphinx-click-process-epilog", set_examples)


def set_examples(_app, _context, lines):
    """The examples below a command's help as they are typed."""
    lines[:] = [".. code-block:: text", "", *(f"    {line.removeprefix('| ')}" for line in lines), ""] if lines else []
