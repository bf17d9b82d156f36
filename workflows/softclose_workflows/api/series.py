"""Owns, from Python, several campaigns at once: study and reproduce."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from softclose_workflows.api.results import Result, metrics
from softclose_workflows.run.executors import Placement

if TYPE_CHECKING:
    from softclose_workflows.studies.reproduced import ReproducedRow
    from softclose_workflows.studies.study import StudyResult


def study(
    source: str,
    out: str | os.PathLike[str],
    *,
    settings: Sequence[str] = (),
    n_switches: int = 100_000,
    top: int = 10,
    serial: bool = False,
) -> Result[StudyResult]:
    """Run a campaign for each value of a parameter and certify each, as `softclose study`; `plot()` draws it.

    Parameters
    ----------
    source
        A shipped study or a TOML file.
    out
        The folder of its stores; what is finished there is not computed again.
    settings
        `section.key=value` each.
    n_switches
        New switches of each certificate.
    top
        Candidates of each certificate.
    serial
        Compute in this process, without Dask.

    Returns
    -------
    Result
        One row a value.
    """
    from softclose_workflows.figures.studying import draw_study
    from softclose_workflows.studies.series import Effort
    from softclose_workflows.studies.study import run_study
    from softclose_workflows.studies.study_file import load_study

    effort = Effort(n_switches=n_switches, top=top, placement=Placement(serial=serial), quiet=True, at_once=1)
    asked = load_study(source, tuple(settings))
    found = run_study(asked, os.fspath(out), effort)
    rows = [
        {"value": value, **metrics(c.best.assessment)}
        for value, c in zip(asked.values, found.certifications, strict=True)
    ]
    return Result(value=found, title=asked.title, rows=rows, figure=lambda: draw_study(found))


def reproduce(
    out: str | os.PathLike[str], *, quick: bool = False, settings: Sequence[str] = (), serial: bool = False
) -> Result[list[ReproducedRow]]:
    """Reproduce the published study, as `softclose reproduce`.

    Parameters
    ----------
    out
        The folder of its stores, tables and figures; what is finished there is not computed again.
    quick
        A smoke test.
    settings
        `section.key=value` each.
    serial
        Compute in this process, without Dask.

    Returns
    -------
    Result
        One row a case.
    """
    from softclose_workflows.figures.reproduction import draw_all
    from softclose_workflows.studies.reproduce import QUICK, QUICK_SWITCHES
    from softclose_workflows.studies.reproduce import reproduce as run
    from softclose_workflows.studies.series import Effort

    effort = Effort(
        n_switches=QUICK_SWITCHES if quick else 100_000,
        top=3 if quick else 10,
        placement=Placement(serial=serial),
        quiet=True,
        at_once=1,
    )
    found = run(os.fspath(out), effort, (*(QUICK if quick else ()), *settings))
    draw_all(Path(out) / "figures", found)
    rows = [{"case": r.certified.name, **metrics(r.certified.assessment)} for r in found]
    return Result(value=found, title="the published study, reproduced", rows=rows)
