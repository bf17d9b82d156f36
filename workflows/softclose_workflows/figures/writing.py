"""Owns writing the figures of a campaign: every one that its store has something for, in every form asked for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from softclose_workflows.figures.drawing import FIGURES
from softclose_workflows.figures.saving import save
from softclose_workflows.figures.style import style
from softclose_workflows.report.data import ReportData
from softclose_workflows.tell.outputs import make_folder


def write_figures(data: ReportData, folder: str, formats: Sequence[str], only: Sequence[str] = ()) -> Iterator[str]:
    """Draw every figure that the store has something for, and yield the path of each file once it is written."""
    target = make_folder(folder, "-o")
    for name in only or FIGURES:
        with style():
            figure = FIGURES[name](data)
        if figure is None:
            continue
        for form in formats:
            path = str(target / f"{name}.{form}")
            save(figure, path, "-o")
            yield path
