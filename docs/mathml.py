"""Owns equations in the HTML pages: LaTeX to MathML when the site is built: pages need no network to be read."""

from __future__ import annotations

from typing import Any

from latex2mathml.converter import convert


def add_mathml(app: Any) -> None:
    """Register the renderer with Sphinx, and choose it."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    app.config.html_math_renderer = "mathml"


def _inline(visitor: Any, node: Any) -> None:
    from docutils import nodes

    visitor.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _block(visitor: Any, node: Any) -> None:
    from docutils import nodes

    visitor.body.append(f'<div class="math">{convert(node.astext(), display="block")}</div>')
    raise nodes.SkipNode
