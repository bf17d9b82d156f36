"""Owns the functions of the facade: the commands' own work, without their words at the terminal."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from softclose.metrics.open_kinds import open_kinds
from softclose.population.calibrate import Calibration, write_calibration
from softclose.population.calibrate import calibrate as fit_population
from softclose.population.measurements import MeasurementError, read_measurements
from softclose.settings import CampaignConfig, load_config
from softclose.uncertainty.sensitivity import Sensitivity
from softclose.uncertainty.tolerance import DriveError, DriveTolerance
from softclose_store import open_campaign, path_text
from softclose_workflows.analyses import drive_errors
from softclose_workflows.analyses import rescore as rescoring
from softclose_workflows.analyses.certification import Certification
from softclose_workflows.analyses.certify import certify as certify_store
from softclose_workflows.analyses.drive_off import drive_off_lines
from softclose_workflows.analyses.finalists import certify_within
from softclose_workflows.analyses.hold import hold_lines, holds_of
from softclose_workflows.analyses.own_limits import limit_lines, own_limits
from softclose_workflows.api.placing import check_main, crew_of
from softclose_workflows.api.results import CampaignRun, Result, Store, metrics, warned
from softclose_workflows.run import extension
from softclose_workflows.run.driving import drive
from softclose_workflows.run.executors import Placement
from softclose_workflows.run.warm_start import warm_started
from softclose_workflows.tell.outputs import check_file, default_name, whole_file, write_text


def run(
    source: str | os.PathLike[str] | Mapping[str, Any],
    store: Store,
    *,
    settings: Iterable[str] = (),
    workers: int | None = None,
    scheduler: str | None = None,
    serial: bool = False,
    break_lock: bool = False,
    quiet: bool = True,
) -> CampaignRun:
    """Run a campaign to its end, or continue the one that the store holds, as `softclose run` does.

    Parameters
    ----------
    source
        Preset (`"current"`), TOML file, or a mapping of sections.
    store
        Path or URL.
    settings
        `section.key=value`, as `--set` takes them.
    workers, scheduler, serial
        Processes of a local cluster (default: one per core), the address of a Dask scheduler, or this process alone.
    break_lock
        Take the lock of a driver that is gone.
    quiet
        No progress on the terminal.

    Raises
    ------
    ConfigError, StoreError
        For what cannot be used, before anything is changed.
    Stopped
        Where it ends earlier; `resume` continues.
    """
    check_main()
    path = path_text(store)
    config = warm_started(load_config(os.fspath(source) if isinstance(source, os.PathLike) else source, settings))
    placement = Placement(workers=workers, scheduler=scheduler, serial=serial)
    drive(path, placement, config=config, break_lock=break_lock, quiet=quiet)
    return CampaignRun(path)


def resume(
    store: Store,
    *,
    budget: int | None = None,
    retry_failed: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    serial: bool = False,
    break_lock: bool = False,
    quiet: bool = True,
) -> CampaignRun:
    """Continue a campaign, extend a finished one, or compute its failed candidates again.

    Parameters
    ----------
    store
        Path or URL.
    budget
        Candidates in all, more than the finished campaign has.
    retry_failed
        Compute failed candidates again, at its end.
    workers, scheduler, serial
        Processes of a local cluster (default: one per core), the address of a Dask scheduler, or this process alone.
    break_lock
        Take the lock of a driver that is gone.
    quiet
        No progress on the terminal.

    Raises
    ------
    ConfigError, StoreError
        For what cannot be used, before anything is changed.
    Stopped
        Where it ends earlier.
    """
    check_main()
    path = path_text(store)
    if budget is not None:
        extension.extend(path, budget, break_lock=break_lock)
    if retry_failed:
        extension.retry_failed(path, break_lock=break_lock)
    drive(path, Placement(workers=workers, scheduler=scheduler, serial=serial), break_lock=break_lock, quiet=quiet)
    return CampaignRun(path)


def open_run(store: Store) -> CampaignRun:
    """A campaign that is there, growing or finished.

    Parameters
    ----------
    store
        Path or URL.

    Raises
    ------
    StoreMissingError
        Where there is none.
    """
    path = path_text(store)
    open_campaign(path)
    return CampaignRun(path)


def certify(
    store: Store,
    *,
    n_switches: int = 100_000,
    seed: int | None = None,
    top: int = 10,
    within_cm_s: float | None = None,
    store_trajectories: bool = False,
    threads: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Result[Certification]:
    """Certify the best candidates on new switches and keep the certificate in the store, as `softclose certify`.

    Parameters
    ----------
    store
        Path, URL, or what `run` returned.
    n_switches
        New switches.
    seed
        Of their ensemble; by default one that no campaign uses.
    top
        Candidates, the best of the training ensemble first.
    within_cm_s
        Eliminate losers and double the sample until the winner is certain to within this [cm/s]; what is
        left is certified, on n_switches at most.
    store_trajectories
        Keep x(t) and v(t) of every new switch under every design, too, and those of the race.
    threads
        Of this process, where nothing else is asked for; by default one per core.
    workers, scheduler
        Processes of a local cluster, or the address of a Dask scheduler, in the place of threads.

    Returns
    -------
    Result
        One row a design; `value` is the certification.

    Raises
    ------
    CertifyError
        For numbers that cannot be used.
    """
    path = path_text(store)
    options: Any = {"n_switches": n_switches, "seed": seed, "top": top, "store_trajectories": store_trajectories}
    with crew_of(workers, scheduler, threads=threads, store=path) as crew:
        if within_cm_s is None:
            found = certify_store(path, **options, mapper=crew)
        else:
            found, _ = certify_within(path, within_cm_s, **options, mapper=crew)
        config = CampaignConfig.from_dict(open_campaign(path).config)
        holds = holds_of(config, found, mapper=crew)
    rows = [
        {"design": d.name, **metrics(d.assessment), "optimism of the training score [cm/s]": d.optimism_cm_s}
        for d in (*found.candidates, *found.references)
    ]
    best = found.best
    return Result(
        value=found,
        title=f"{path} on {found.n_switches:,} new switches",
        rows=rows,
        notes=(
            open_kinds(best.response, best.assessment.closed_by_us).sentence,
            *limit_lines(own_limits(config, best.response, best.assessment, fresh=True)),
            *warned(best.assessment),
            *hold_lines(holds, best.assessment.level),
            *drive_off_lines(found.drive_off, found.n_switches),
        ),
        figure=lambda: CampaignRun(path).plot("densities"),
    )


def rescore(
    store: Store,
    objective: Iterable[str] = (),
    *,
    closed_by_us: float | None = None,
    impacts: str = "all",
    impacts_until_us: float | None = None,
) -> Result[list[rescoring.Rescored]]:
    """Rank all candidates under another objective, without simulating.

    Parameters
    ----------
    store
        Path, URL, or what `run` returned.
    objective
        `"level=0.99"`, `"c1_cm_s=50"`: keys of the section `objective`.
    closed_by_us
        Switches that are not closed for good by then [µs] count as open.
    impacts
        `"all"`, or `"first"`: which impacts decide the contact speed.
    impacts_until_us
        Later ones [µs] do not.

    Returns
    -------
    Result
        One row a candidate, the best first.
    """
    score = rescoring.Score(
        objective=tuple(objective), closed_by_us=closed_by_us, impacts=impacts, impacts_until_us=impacts_until_us
    )
    path = path_text(store)
    found = rescoring.rescore(path, score)
    rows = [
        {"candidate": r.candidate, "rank": r.rank, "before": r.rank_before, "switches": r.n_switches}
        | metrics(r.assessment)
        for r in found
    ]
    return Result(value=found, title=f"{path}, rescored", rows=rows, notes=warned(*(r.assessment for r in found[:1])))


def tolerance(
    store: Store,
    errors: Sequence[DriveError] = (),
    *,
    candidate: int | None = None,
    n_switches: int = 20_000,
    n_generators: int = 64,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Result[list[DriveTolerance]]:
    """How v_u and p_nc of a waveform move with errors of its generator.

    Parameters
    ----------
    store
        Path, URL, or what `run` returned.
    errors
        By default a usual set of them.
    candidate
        By default the best certified, else the best.
    n_switches
        New switches.
    n_generators
        Generators drawn for random errors.
    workers, scheduler
        Processes of a local cluster, or the address of a Dask scheduler, in the place of threads.

    Returns
    -------
    Result
        One row an error.
    """
    path = path_text(store)
    with crew_of(workers, scheduler) as crew:
        chosen, found = drive_errors.tolerance(
            path, errors, candidate=candidate, n_switches=n_switches, n_generators=n_generators, mapper=crew
        )
    rows = [
        {"generator": drive_errors.describe(r.error), **metrics(r.assessment)}
        | {"change of v_u [cm/s]": r.v_u_shift_cm_s, "change of p_nc": r.p_nc_shift}
        for r in found
    ]
    title = f"candidate {chosen.candidate} ({chosen.why}) of {path} on {n_switches:,} new switches"
    return Result(value=found, title=title, rows=rows)


def sensitivity(
    store: Store,
    *,
    candidate: int | None = None,
    points: int = 512,
    replicates: int = 8,
    seed: int = 0,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Result[Sensitivity]:
    """Which of D, G, E and T the spread of V and the failure to close come from (Sobol' indices).

    Parameters
    ----------
    store
        Path, URL, or what `run` returned.
    candidate
        By default the best certified, else the best.
    points
        Points of a design, a power of two.
    replicates
        Independent designs, from which the intervals come.
    seed
        Of the designs.
    workers, scheduler
        Processes of a local cluster, or the address of a Dask scheduler, in the place of threads.

    Returns
    -------
    Result
        One row an index.
    """
    path = path_text(store)
    with crew_of(workers, scheduler) as crew:
        chosen, found = drive_errors.sensitivity(
            path, candidate=candidate, points=points, replicates=replicates, seed=seed, mapper=crew
        )
    rows = [
        {
            "of": {"v_cm_s": "V", "closed": "closing"}[i.output],
            "from": i.variable,
            "by itself": i.first,
            "with interactions": i.total,
        }
        for i in found.indices
    ]
    title = f"candidate {chosen.candidate} ({chosen.why}) of {path}: shares of the variance"
    return Result(value=found, title=title, rows=rows)


def calibrate(
    measurements: str | os.PathLike[str],
    output: str | os.PathLike[str] | None = None,
    *,
    name: str | None = None,
    columns: Mapping[str, str] | None = None,
    **settings: Any,
) -> Result[Calibration]:
    """Fit a population to device measurements.

    Parameters
    ----------
    measurements
        CSV file.
    output
        TOML file to write, which `population.name` takes.
    name
        Of the population; by default that of the file.
    columns
        Which column of the file is which, where its heading calls it otherwise: `{"G_um": "gap"}`.
    **settings
        `bounds`, `plate_area_um2`, `n_bootstrap`, `confidence` and `seed` of `softclose.population.calibrate`.

    Returns
    -------
    Result
        One row a fitted number.
    """
    if not isinstance(measurements, str | os.PathLike):
        raise MeasurementError(f"{measurements!r} is no file of measurements; give the path of a CSV")
    source = Path(measurements)
    target = None if output is None else check_file(Path(output), "output", [".toml"])
    found = fit_population(read_measurements(source, columns=columns), name=name or (target or source).stem, **settings)
    if target is not None:
        with whole_file(target, "output") as partial:
            write_calibration(found, partial)
    rows = [
        {"variable": v, "number": number, "value": e.value, "lower": e.interval[0], "upper": e.interval[1]}
        | {"p of the fit": f.p_value}
        for v, f in found.fits.items()
        for number, e in f.numbers.items()
    ]
    return Result(value=found, title=f"population fitted to {source.name}", rows=rows, notes=found.notes)


def report(
    store: Store,
    output: str | os.PathLike[str] | None = None,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Path:
    """Write the self-contained HTML page about a campaign.

    Parameters
    ----------
    store
        Path, URL, or what `run` returned.
    output
        By default `<name of the store>.html`, in the current folder.
    workers, scheduler
        Processes of a local cluster, or the address of a Dask scheduler, that simulate the reference designs in the
        place of threads.

    Returns
    -------
    Path
        Where it is.
    """
    from softclose_workflows.report.gather import gather
    from softclose_workflows.report.page import render_report

    path = path_text(store)
    target = check_file(Path(default_name(path, ".html") if output is None else output), "output")
    with crew_of(workers, scheduler) as crew:
        data = gather(path, mapper=crew)
    write_text(target, render_report(data), "output")
    return target
