"""Owns, from Python, what shows a campaign: figures, export, pareto, opening, serve."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store import open_campaign
from softclose_workflows.analyses.chosen import choose
from softclose_workflows.api.placing import crew_of
from softclose_workflows.api.results import Result, Store, path_text
from softclose_workflows.errors import ExportError
from softclose_workflows.tell.outputs import check_file, write_text

if TYPE_CHECKING:
    import xarray as xr

    from softclose.opening import Openings
    from softclose_workflows.report.live import Server


def figures(
    store: Store, folder: str | os.PathLike[str], *, formats: Sequence[str] = ("png",), only: Sequence[str] = ()
) -> list[Path]:
    """Write the figures of a campaign for publication, as `softclose figures`.

    Parameters
    ----------
    store
        Path, URL, or what `run` returned.
    folder
        Where to; it is made where it is missing.
    formats
        png, svg, pdf.
    only
        Names of figures; by default all that the store has something for.

    Returns
    -------
    list of Path
        What was written.
    """
    from softclose_workflows.figures.writing import write_figures
    from softclose_workflows.report.gather import gather

    learned = not only or any(name.startswith("dependence") for name in only)
    data = gather(path_text(store), learned=learned, picks=False)
    return [Path(path) for path in write_figures(data, os.fspath(folder), formats, only)]


def export(
    store: Store,
    what: Literal["waveform", "ensemble", "history", "trim"],
    output: str | os.PathLike[str] | None = None,
    *,
    candidate: int | None = None,
    trajectories: bool = False,
    rows: int = 41,
    devices: str | os.PathLike[str] | None = None,
    columns: str | None = None,
    **settings: Any,
) -> xr.Dataset | str | bytes:
    """What `softclose export` writes: a dataset (ensemble, history), or the content of a file (waveform, trim).

    Parameters
    ----------
    store
        Path, URL, or what `run` returned.
    what
        waveform: volts over time; ensemble: every switch of one candidate; history: one row a candidate; trim: scales
        of the drive for what is measured on a switch.
    output
        A file to write it to as well: .csv, .parquet or .nc of a dataset, any name of a waveform or trim. Codes and
        files of generators have a description beside them, with .json after their name.
    candidate
        By default the best certified one.
    trajectories
        ensemble: x(t), v(t) and the impacts of every switch, too.
    rows
        trim: values of each measured quantity.
    devices
        trim: a CSV file of measured devices, in the place of rows.
    columns
        trim: how its columns are called, such as "pull_in_V=Vpi".
    **settings
        waveform: what the command's options say. format is csv, pwl, dac, keysight-arb, tektronix-tfw or siglent-csv;
        the others are rate_MSps, duration_us, tolerance_mV, source, nodes, bits, full_scale_V, gain, signed, header,
        max_error_cm_s, release, pull_in_V and resonance_kHz.

    Returns
    -------
    xarray.Dataset, str or bytes
        The exported values; bytes for files of generators.

    Raises
    ------
    ExportError
        For something else than these four, for settings that a format does not have, and for samples that are no
        longer the waveform.
    """
    from softclose_workflows.exports.drive_files import drive_file
    from softclose_workflows.exports.formats import DriveSettings
    from softclose_workflows.exports.tables import ensemble_dataset, history_dataset, write_dataset
    from softclose_workflows.exports.trim import scales_table

    target = None if output is None else check_file(os.fspath(output), "output")
    path = path_text(store)
    campaign = open_campaign(path)
    if settings and what != "waveform":
        raise ExportError(f"{what} has no {', '.join(settings)}")
    if what in ("history", "ensemble"):
        dataset = (
            history_dataset(campaign)
            if what == "history"
            else ensemble_dataset(campaign, choose(path, candidate).candidate, trajectories=trajectories)
        )
        if target is not None:
            form = {".nc": "netcdf", ".parquet": "parquet"}.get(target.suffix, "csv")
            write_dataset(dataset, target, form)
        return dataset
    if what not in ("waveform", "trim"):
        raise ExportError(f"{what!r} is nothing to export; give waveform, ensemble, history or trim")
    if what == "waveform":
        drive = drive_file(campaign, choose(path, candidate).candidate, DriveSettings.of(**settings))
        if target is not None:
            drive.write(target)
        return drive.content
    text = scales_table(
        CampaignConfig.from_dict(campaign.config),
        Waveform.from_rows(campaign.waveform(choose(path, candidate).candidate)),
        rows=rows,
        devices=None if devices is None else Path(devices),
        columns=columns,
    )
    if target is not None:
        write_text(target, text, "output")
    return text


def pareto(store: Store, objectives: Sequence[str] = ()) -> Result[dict[str, Any]]:
    """List the candidates that no other beats in all objectives at once, as `softclose pareto`; `plot()` draws them.

    Parameters
    ----------
    store
        Path, URL, or what `run` returned.
    objectives
        Two to four of v_u, p_nc, closing and peak; by default the campaign's own.

    Returns
    -------
    Result
        One row a candidate of the front.
    """
    from softclose_workflows.analyses.front import front_to_json

    found = front_to_json(path_text(store), tuple(objectives))
    names = [name for name in found["front"][0] if not name.endswith("_interval") and name != "waveform"]
    rows = [{name: row[name] for name in names} for row in found["front"]]
    title = f"{path_text(store)}: {len(rows)} candidates on the front of {' and '.join(found['objectives'])}"
    return Result(value=found, title=title, rows=rows, figure=lambda: _front_figure(rows, found["objectives"]))


def _front_figure(rows: Sequence[dict[str, Any]], objectives: Sequence[str]) -> Any:
    from matplotlib.figure import Figure

    from softclose_workflows.figures.style import style

    columns = {"v_u": "v_u_cm_s", "p_nc": "p_nc", "closing": "closing_us", "peak": "peak_volts"}
    y, x = (columns[name] for name in objectives[:2])
    with style():
        figure = Figure(layout="constrained")
        axes = figure.add_subplot()
        axes.plot([row[x] for row in rows], [row[y] for row in rows], "o-")
        axes.set_xlabel(x)
        axes.set_ylabel(y)
    return figure


def opening(
    store: Store,
    *,
    at_us: float | None = None,
    brake: int = 0,
    n_switches: int = 10_000,
    candidate: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Result[Openings]:
    """Show how the switches open at release, as `softclose opening`; `plot()` draws their motion.

    Parameters
    ----------
    store
        Path, URL, or what `run` returned.
    at_us
        When the holding pulse begins to fall [µs]; by default as the campaign designs it.
    brake
        Brakes to try; 0: none is designed.
    n_switches
        New switches.
    candidate
        By default the best certified one.
    workers, scheduler
        Processes of a local cluster, or the address of a Dask scheduler, in the place of threads.

    Returns
    -------
    Result
        One row without, one with a brake.
    """
    from softclose_workflows.analyses.opening import opening as analyse
    from softclose_workflows.figures.opening import draw_opening

    path = path_text(store)
    with crew_of(workers, scheduler, store=path) as crew:
        found = analyse(
            path, at_us=at_us, candidate=candidate, brake=brake, n_switches=n_switches, mapper=crew, listener=None
        )
    o = found.openings
    rows = [
        {
            "release": name,
            "overshoot [travels]": each.overshoot,
            "touch again": each.p_rebound.estimate,
            "stuck closed": each.p_stuck.estimate,
            "at rest after [µs]": each.rest_us,
        }
        for name, each in (("the holding pulse falls", o.plain), ("with a brake", o.braked))
        if each is not None
    ]
    title = f"{path}, candidate {found.chosen.candidate}, released at {o.at_us:g} µs: {o.plain.n:,} closed switches"
    return Result(value=o, title=title, rows=rows, figure=lambda: draw_opening(o, title))


def serve(folder: str | os.PathLike[str], port: int = 0) -> Server:
    """Show all campaigns of a folder in the browser, as `softclose serve`, until `shutdown()` of what is returned.

    Parameters
    ----------
    folder
        What the stores are in, or a store.
    port
        Of this machine's loopback; 0: any that is free.

    Returns
    -------
    Server
        It runs already; its `address` is where.
    """
    from softclose_workflows.report.live import Server

    server = Server(Path(folder).absolute(), port)
    threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.2}, daemon=True).start()
    return server
