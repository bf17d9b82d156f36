"""Owns, from Python, what judges a waveform: sign, assess, compare, compare_engines."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from softclose.waveform import Trace, read_record
from softclose_workflows.analyses.assessed_trace import AssessedTrace, assess_trace
from softclose_workflows.analyses.signing import Sheet, parsed_limits
from softclose_workflows.analyses.signing import sign as held
from softclose_workflows.api.placing import crew_of
from softclose_workflows.api.results import Result, Store, differences_rows, metrics, path_text, warned

if TYPE_CHECKING:
    from softclose_workflows.analyses.engines import Compared
    from softclose_workflows.report.comparison import Entry


def sign(
    store: Store, limits: Mapping[str, float] | None = None, output: str | os.PathLike[str] | None = None
) -> Result[Sheet]:
    """Hold the best certified waveform against limits, as `softclose sign`.

    Parameters
    ----------
    store
        Path, URL, or what `run` returned; it has a certificate.
    limits
        By quantity, in its unit, such as `{"v_u": 20.0, "p_nc": 0.05}`.
    output
        Where to write the page, an HTML file; by default none is written.

    Returns
    -------
    Result
        One row a quantity; `value.verdict` is that of the whole sheet.

    Raises
    ------
    SignError
        Where nothing is certified, or a limit is none.
    """
    from softclose_workflows.report.sign_page import render_sign
    from softclose_workflows.tell.outputs import check_file, write_text

    target = None if output is None else check_file(os.fspath(output), "output")
    sheet = held(path_text(store), parsed_limits([], limits))
    if target is not None:
        write_text(target, render_sign(sheet), "output")
    rows = [
        {
            "quantity": line.quantity.name,
            "value": line.value.estimate,
            "lower": line.value.interval[0],
            "upper": line.value.interval[1],
            "unit": line.quantity.unit,
            "limit": line.limit,
            "verdict": line.verdict,
        }
        for line in sheet.lines
    ]
    title = f"{path_text(store)}: {sheet.verdict}, on {sheet.certification.n_switches:,} new switches"
    return Result(value=sheet, title=title, rows=rows, notes=warned(sheet.best.assessment))


def assess(
    source: Store,
    trace: Trace | str | os.PathLike[str],
    *,
    n_switches: int = 100_000,
    seed: int | None = None,
    scale: float | None = None,
    max_volts: float | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Result[AssessedTrace]:
    """Judge a drive that was recorded or drawn, as `softclose assess`.

    Parameters
    ----------
    source
        A store, a preset or a TOML file: whose lot and objective are used.
    trace
        The drive, or a table of instants [µs] and volts to read it from.
    n_switches
        New switches.
    seed
        Of their ensemble; by default that of the store's certificate.
    scale
        Voltages are multiplied by it: of a probe, a monitor output, or an amplifier whose input was recorded. A drive
        that closes nothing is refused unless a scale is given; 1 says that it is the drive.
    max_volts
        Highest voltage that the drive may reach [V]; by default that of the campaign.
    workers, scheduler
        Processes of a local cluster, or the address of a Dask scheduler, in the place of threads.

    Returns
    -------
    Result
        The drive, and the best waveform of a store on the same switches; its notes say how a table was read.

    Raises
    ------
    WaveformError
        For a table that is not certain, and for a drive that is too high, or so low that nothing would close.
    """
    factor = 1.0 if scale is None else scale
    read: tuple[str, ...] = ()
    if isinstance(trace, Trace):
        drive = Trace(trace.times_us, factor * trace.volts)
    else:
        record = read_record(os.fspath(trace), scale=factor)
        drive, read = record.trace, record.notes
    with crew_of(workers, scheduler) as crew:
        found = assess_trace(
            path_text(source),
            drive,
            n_switches=n_switches,
            seed=seed,
            mapper=crew,
            max_volts=max_volts,
            scaled=scale is not None,
        )
    rows = [{"drive": "as recorded", **metrics(found.assessment)}]
    if found.best is not None and found.best_assessment is not None:
        rows.append({"drive": f"candidate {found.best.candidate}", **metrics(found.best_assessment)})
    title = f"{path_text(source)}: a recorded drive on {n_switches:,} new switches"
    return Result(value=found, title=title, rows=rows, notes=(*read, *warned(found.assessment)))


def compare(
    stores: Sequence[Store], *, fresh: int = 0, workers: int | None = None, scheduler: str | None = None
) -> Result[list[Entry]]:
    """Compare the best designs of two or more campaigns, as `softclose compare`; `plot()` draws them.

    Parameters
    ----------
    stores
        Paths, URLs, or what `run` returned.
    fresh
        Judge all on so many new switches; 0: as each store has it, certified or by its training score.
    workers, scheduler
        Processes of a local cluster, or the address of a Dask scheduler, in the place of threads.

    Returns
    -------
    Result
        One row a campaign.

    Raises
    ------
    CompareError
        For fewer than two.
    """
    from softclose_workflows.figures.comparing import draw_comparison
    from softclose_workflows.report.comparison import differences, read_entries

    with crew_of(workers, scheduler) as crew:
        entries = read_entries([path_text(store) for store in stores], fresh, mapper=crew)
    rows = [
        {"campaign": e.label, "judged on": e.basis, **({} if e.design is None else metrics(e.design.assessment))}
        for e in entries
    ]
    names = max((list(row) for row in rows), key=len)
    rows = [{name: row.get(name, "") for name in names} for row in rows]
    warnings = [f"{e.label}: {warning}" for e in entries for warning in e.warnings]
    notes = (*differences_rows(differences(entries)), *warnings)
    return Result(
        value=entries,
        title=f"{len(entries)} campaigns",
        rows=rows,
        notes=notes,
        figure=lambda: draw_comparison(entries),
    )


def compare_engines(
    source: str,
    engines: Sequence[str],
    *,
    seeds: Sequence[int] = (1, 2, 3),
    settings: Sequence[str] = (),
    n_switches: int = 20_000,
) -> Result[list[Compared]]:
    """Compare search engines on one problem, in this process, as `softclose compare-engines`; `plot()` draws them.

    Parameters
    ----------
    source
        A preset or a TOML file.
    engines
        Their names.
    seeds
        Each engine runs from each of them.
    settings
        `section.key=value` each.
    n_switches
        New switches that certify each best waveform; 0: none.

    Returns
    -------
    Result
        One row a run.
    """
    from softclose.plugins import ENGINES
    from softclose.settings import load_config
    from softclose_workflows.analyses.engines import compare as run
    from softclose_workflows.figures.engines import draw_engines

    for name in engines:
        ENGINES.check(name)
    found = run(load_config(source, settings), list(engines), list(seeds), n_switches, quiet=True)
    rows = [
        {
            "engine": r.run.engine,
            "seed": r.run.seed,
            "training g [cm/s]": r.run.best.g_cm_s,
            "certified g [cm/s]": r.certified_g_cm_s,
            "wall [s]": float(r.run.wall_s[-1]),
        }
        for r in found
    ]
    title = f"{source}: {len(engines)} engines, {len(seeds)} seeds"
    return Result(value=found, title=title, rows=rows, figure=lambda: draw_engines(found))
