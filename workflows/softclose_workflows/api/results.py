"""Owns what Python gets back: an object with the numbers, a short `repr`, and a table in a notebook."""

from __future__ import annotations

import html
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from softclose.metrics.objective import Assessment
from softclose.waveform import Waveform
from softclose_store import Campaign, open_campaign
from softclose_store import path_text as path_text
from softclose_workflows.tell.plain import waveform_rows
from softclose_workflows.tell.standing import Standing, read_standing
from softclose_workflows.tell.tables import (
    beside,
    describe_waveform,
    difference_with_interval,
    n_failed_of,
    points,
    share,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from softclose.metrics.paired import Comparison

T = TypeVar("T")

Store = str | os.PathLike[str]
"""A path, a URL, or what `run` returned."""

MOST_ROWS = 10
"""Rows that are shown; `rows` and `to_frame()` have all."""


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Result(Generic[T]):
    """What an analysis found."""

    value: T
    """The analysis's own result."""
    title: str
    """What it is, in one line."""
    rows: Sequence[Mapping[str, Any]]
    """One mapping of plain values a row: name with its unit -> value."""
    notes: tuple[str, ...] = ()
    """What a reader should know beside the table."""
    figure: Callable[[], Figure] | None = None
    """What `plot` draws; None where the analysis has no figure."""

    def plot(self) -> Figure:
        """The command's own figure, by matplotlib. Raises ValueError where it has none: plot `to_frame()`."""
        if self.figure is None:
            raise ValueError(f"{self.title}: there is no figure of this; plot what to_frame() gives")
        from softclose_workflows.figures.saving import shown
        from softclose_workflows.figures.style import style

        with style():
            return shown(self.figure())

    def to_frame(self) -> pd.DataFrame:
        """The rows as a pandas frame; pandas is asked for here only."""
        import pandas as pd

        return pd.DataFrame([dict(row) for row in self.rows])

    def __repr__(self) -> str:
        names = list(self.rows[0]) if self.rows else []
        cells = [names, *([_shown(row[name]) for name in names] for row in self.rows[:MOST_ROWS])]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = ["  ".join(f"{cell:<{w}}" for cell, w in zip(row, widths, strict=True)).rstrip() for row in cells]
        return "\n".join([self.title, *lines, *self._more(), *self.notes])

    def _repr_html_(self) -> str:
        names = list(self.rows[0]) if self.rows else []
        head = "".join(f"<th>{html.escape(name)}</th>" for name in names)
        body = "".join(
            "<tr>" + "".join(f"<td>{html.escape(_shown(row[name]))}</td>" for name in names) + "</tr>"
            for row in self.rows[:MOST_ROWS]
        )
        below = "".join(f"<p>{html.escape(line)}</p>" for line in (*self._more(), *self.notes))
        return (
            f"<table><caption>{html.escape(self.title)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody>"
            f"</table>{below}"
        )

    def _more(self) -> list[str]:
        left = len(self.rows) - MOST_ROWS
        return [f"… and {left} more rows (to_frame())"] if left > 0 else []


@dataclass(frozen=True, slots=True, repr=False)
class CampaignRun(os.PathLike[str]):
    """A campaign in its store: a path to every function that takes one."""

    store: str
    """Path or URL."""

    def __fspath__(self) -> str:
        return self.store

    @property
    def standing(self) -> Standing:
        """Where it stands now: candidates, failures, the best."""
        return read_standing(self.store)

    @property
    def campaign(self) -> Campaign:
        """The reader of all that is stored."""
        return open_campaign(self.store)

    @property
    def waveform(self) -> Waveform:
        """The best candidate's. Raises ValueError before there is one."""
        best = self.standing.best
        if best is None:
            raise ValueError(f"{self.store} has no usable candidate yet: let the campaign run first")
        return Waveform.from_rows(best.waveform)

    def plot(self, name: str = "response") -> Figure:
        """One of the figures that `softclose figures` writes, by its name: response, histogram, convergence, …

        Raises ValueError for an unknown name, and where the store has nothing for it.
        """
        from softclose_workflows.figures.drawing import FIGURES
        from softclose_workflows.figures.saving import shown
        from softclose_workflows.figures.style import style
        from softclose_workflows.report.gather import gather

        if name not in FIGURES:
            raise ValueError(f"{name!r} is no figure; there are {', '.join(FIGURES)}")
        with style():
            drawn = FIGURES[name](gather(self.store, learned=name.startswith("dependence"), picks=False))
        if drawn is None:
            raise ValueError(f"{self.store} has nothing to draw in {name!r} yet")
        return shown(drawn)

    def __repr__(self) -> str:
        return "\n".join(self._lines())

    def _repr_html_(self) -> str:
        first, *rest = map(html.escape, self._lines())
        return "<br>".join([f"<strong>{first}</strong>", *rest])

    def _lines(self) -> list[str]:
        s = self.standing
        lines = [f"{s.name}: {s.committed} of {s.budget} candidates in {self.store}"]
        if s.best is not None:
            b = s.best
            lines.append(
                f"best: candidate {b.candidate}, g {b.g_cm_s:.2f} cm/s, v_u {b.v_u_cm_s:.2f} cm/s, "
                f"{share(b.p_nc)} left open on {b.n_switches:,} switches" + beside(n_failed_of(b), b.n_switches)
            )
            lines += filter(None, [s.warning])
            lines += describe_waveform(waveform_rows(b.waveform)).splitlines()
        return lines


def metrics(a: Assessment) -> dict[str, float]:
    """The columns that every table of designs has."""
    return {
        "g [cm/s]": a.g_cm_s,
        "g lower": a.g_interval[0],
        "g upper": a.g_interval[1],
        "v_u [cm/s]": a.v_u_cm_s,
        "mean V [cm/s]": a.mean_cm_s,
        "p_nc": a.p_nc,
    }


def differences_rows(found: Sequence[tuple[str, str, Comparison]]) -> list[str]:
    """A sentence a difference of two campaigns on the same switches."""
    return [
        f"{label} against {first}: v_u {difference_with_interval(c.v_u_cm_s)} cm/s, left open {points(c.p_nc)} points"
        for label, first, c in found
    ]


def warned(*assessments: Assessment) -> tuple[str, ...]:
    """Notes where waveforms leave many switches open."""
    return tuple(a.open_warning for a in assessments if a.open_warning)


def _shown(value: Any) -> str:
    if not isinstance(value, float):
        return str(value)
    return "–" if math.isnan(value) else f"{value:.4f}" if abs(value) < 1.0 else f"{value:.2f}"
