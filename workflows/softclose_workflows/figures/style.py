"""Owns the look of figures on paper: sizes of journal columns, small type, the report's colours."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any

from softclose_workflows.tell.labels import PALETTE
from softclose_workflows.terminal import visible

COLOURS = PALETTE["light"]
"""Paper is light."""

COLUMN_IN = 3.5
"""Width of one column [inch]."""

PAGE_IN = 7.16
"""Width of two columns [inch]."""

RC: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],  # comes with matplotlib: the same picture on every machine
    "font.size": 8.0,
    "axes.labelsize": 8.0,
    "axes.titlesize": 8.0,
    "legend.fontsize": 7.5,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": COLOURS["muted"],
    "axes.labelcolor": COLOURS["ink"],
    "text.color": COLOURS["ink"],
    "xtick.color": COLOURS["muted"],
    "ytick.color": COLOURS["muted"],
    "xtick.labelcolor": COLOURS["ink"],
    "ytick.labelcolor": COLOURS["ink"],
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": COLOURS["grid"],
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
    "savefig.dpi": 300,
    "pdf.fonttype": 42,  # TrueType: journals refuse Type 3
    "svg.fonttype": "path",  # looks the same where the font is missing
    "svg.hashsalt": "softclose",  # the same store gives the same bytes
}


def literal(text: str) -> str:
    """A name as text: matplotlib would read what stands between dollar signs as mathematics, and fail."""
    return visible(text).replace("$", r"\$")


def style() -> AbstractContextManager[None]:
    """For the length of a `with` block every figure that is made looks like this."""
    import matplotlib  # here: it is slow to import

    return matplotlib.rc_context(RC)
