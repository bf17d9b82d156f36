"""Owns figures on the disk: PNG, SVG and PDF in one style, the same bytes from the same data, whole or not at all."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from softclose_workflows.figures.style import style
from softclose_workflows.tell.outputs import check_file, whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
"""Neither when nor with which version: a figure under version control changes only where the picture does."""

FORMATS = tuple(METADATA)


def check_figure(path: str | Path, option: str = "--figure") -> Path:
    """The path of a figure that can be written, found out before the work is done. Raises OutputError."""
    return check_file(path, option, [f".{form}" for form in FORMATS])


def save(figure: Figure, path: str | Path, option: str = "--figure") -> None:
    """Write in the form that the name ends with. Raises OutputError."""
    target = check_figure(path, option)
    form = target.suffix.removeprefix(".").lower()
    with style(), whole_file(target, option) as partial:
        figure.savefig(partial, format=form, metadata=METADATA[form])


def shown(figure: Figure) -> Figure:
    """The same figure, which a notebook shows by itself: pyplot, which would, is not asked to draw ours."""

    def png() -> bytes:
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=100)
        return buffer.getvalue()

    setattr(figure, "_repr_png_", png)  # noqa: B010 - matplotlib's type has no such name
    return figure
