"""Owns writing figures: PNG, SVG and PDF, the same bytes from the same store."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib

from softclose_workflows.figures.drawing import FIGURES
from softclose_workflows.figures.style import RC
from softclose_workflows.report.data import ReportData
from softclose_workflows.report.files import OutputError, write_bytes

FORMATS = ("png", "svg", "pdf")

METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
"""Neither when nor with which version: a figure under version control changes only where the picture does."""


def write_figures(data: ReportData, folder: str, formats: Sequence[str], only: Sequence[str] = ()) -> Iterator[str]:
    """Draw every figure that the store has something for, and yield the path of each file once it is written."""
    target = Path(folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as e:
        raise OutputError(f"cannot make the folder {folder}: {e.strerror or e}; choose another with -o") from e
    with matplotlib.rc_context(RC):
        for name in only or FIGURES:
            figure = FIGURES[name](data)
            if figure is None:
                continue
            for kind in formats:
                buffer = io.BytesIO()
                figure.savefig(buffer, format=kind, metadata=METADATA[kind])
                path = str(target / f"{name}.{kind}")
                write_bytes(path, buffer.getvalue())
                yield path
