"""Owns `softclose export`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from softclose.waveform import Waveform
    from softclose_store import Campaign

Command = TypeVar("Command", bound=Callable[..., Any])


def candidate_option(command: Command) -> Command:
    """--candidate."""
    return click.option(
        "--candidate", type=int, metavar="N", help="Which candidate [the best certified one, or else the best]."
    )(command)


def output_option(command: Command) -> Command:
    """-o."""
    return click.option(
        "-o",
        "--output",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Where to write [standard output: text only].",
    )(command)


@click.group(
    epilog="\b\nExamples:\n"
    "  softclose export runs/a.zarr waveform --rate 50 -o drive.csv\n"
    "  softclose export runs/a.zarr waveform --format pwl --tolerance 0.5 -o drive.cir\n"
    "  softclose export runs/a.zarr waveform --format dac --bits 14 --full-scale 200 -o drive.txt\n"
    "  softclose export runs/a.zarr ensemble --format netcdf --trajectories -o best.nc\n"
    "  softclose export runs/a.zarr history > history.csv"
)
@click.argument("store", metavar="STORE")
@click.pass_context
def export(ctx: click.Context, store: str) -> None:
    """Write the waveform, the ensemble or the history of the campaign in STORE for other programs.

    A file appears whole, under its own name, or not at all. An existing file is replaced.
    """
    ctx.obj = store


@export.command(
    epilog="\b\nExamples:\n"
    "  softclose export runs/a.zarr waveform --rate 50 -o drive.csv\n"
    "  softclose export runs/a.zarr waveform --format pwl -o drive.cir\n"
    "  softclose export runs/a.zarr waveform --format dac --bits 14 --full-scale 200 -o drive.txt"
)
@click.option(
    "--format",
    "form",
    type=click.Choice(["csv", "pwl", "dac"]),
    default="csv",
    show_default=True,
    help="csv: volts at a sample rate; pwl: a SPICE source; dac: integer codes for a waveform generator.",
)
@candidate_option
@click.option(
    "--rate", "rate_MSps", type=float, default=10.0, show_default=True, metavar="MS/s", help="csv, dac: samples per µs."
)
@click.option("--duration", "duration_us", type=float, metavar="µs", help="csv, dac: length [the campaign's horizon].")
@click.option(
    "--tolerance",
    "tolerance_mV",
    type=float,
    default=1.0,
    show_default=True,
    metavar="mV",
    help="pwl: largest deviation of the straight lines from the waveform.",
)
@click.option("--source", default="Vdrive", show_default=True, help="pwl: name of the voltage source.")
@click.option("--nodes", default="drive 0", show_default=True, help="pwl: its positive and negative node.")
@click.option("--bits", type=int, default=14, show_default=True, help="dac: resolution.")
@click.option(
    "--full-scale",
    "full_scale_V",
    type=float,
    metavar="V",
    help="dac: voltage at the switch of the largest code, amplifier included [the campaign's max_volts].",
)
@click.option(
    "--signed/--unsigned", default=True, show_default=True, help="dac: two's complement, or 0 V as lowest code."
)
@click.option(
    "--header/--no-header",
    default=True,
    show_default=True,
    help="dac: lines beginning with # before the codes; FILE.json says the same in any case.",
)
@output_option
@click.pass_obj
def waveform(store: str, /, form: str, candidate: int | None, output: Path | None, **settings: Any) -> None:
    """The drive waveform of one candidate."""
    from softclose.waveform import Waveform
    from softclose_store import open_campaign

    _check(output)
    campaign = open_campaign(store)
    i = _candidate(campaign, candidate)
    drive = Waveform.from_rows(campaign.waveform(i))
    if form == "pwl":
        from softclose_workflows.exports.pwl import draw, spice_source

        line = draw(drive, settings["tolerance_mV"] * 1e-3)
        text = spice_source(
            line, source=settings["source"], nodes=settings["nodes"], comments=_comments(campaign, i, drive)
        )
        _emit(text, output)
        return
    from softclose_workflows.exports.samples import sample_times_us, volts_csv

    duration = settings["duration_us"] or campaign.config["model"]["horizon_us"]
    if settings["duration_us"] == 0.0:
        duration = 0.0  # refused below, with the value that was given
    times = sample_times_us(settings["rate_MSps"], duration)
    if form == "csv":
        _emit(volts_csv(drive, times), output)
    else:
        _emit_codes(campaign, i, drive, times, settings, output)


def _emit_codes(
    campaign: Campaign, i: int, drive: Waveform, times: Any, settings: dict[str, Any], output: Path | None
) -> None:
    from softclose_workflows.errors import ExportError
    from softclose_workflows.exports.samples import Scale, codes_text, metadata
    from softclose_workflows.tell.plain import json_text

    full_scale = settings["full_scale_V"]
    scale = Scale(
        bits=settings["bits"],
        signed=settings["signed"],
        rate_MSps=settings["rate_MSps"],
        full_scale_V=campaign.config["waveform"]["max_volts"] if full_scale is None else full_scale,
    )
    if output is None and not settings["header"]:
        raise ExportError(
            "codes without a header say nothing of their scale; give a file (-o), which FILE.json describes"
        )
    volts = drive.voltage(times)
    codes = scale.encode(volts)
    about = metadata(scale, codes, volts)
    comments = [*_comments(campaign, i, drive), *(f"{name}: {value}" for name, value in about.items())]
    text = codes_text(codes, comments if settings["header"] else [])
    if output is not None:  # the description first: codes never lie about without their scale
        about |= {"candidate": i, "fingerprint": campaign.fingerprint}
        _emit(json_text(about) + "\n", output.with_name(output.name + ".json"))
    _emit(text, output)


@export.command(
    epilog="\b\nExamples:\n  softclose export runs/a.zarr ensemble -o best.csv\n"
    "  softclose export runs/a.zarr ensemble --format netcdf --trajectories -o best.nc"
)
@click.option("--format", "form", type=click.Choice(["csv", "parquet", "netcdf"]), default="csv", show_default=True)
@candidate_option
@click.option("--trajectories", is_flag=True, help="netcdf: x(t), v(t) and the impacts of every switch too.")
@output_option
@click.pass_obj
def ensemble(store: str, /, form: str, candidate: int | None, trajectories: bool, output: Path | None) -> None:
    """Every switch of one candidate: its properties and its response."""
    from softclose_store import open_campaign
    from softclose_workflows.exports.tables import ensemble_dataset

    _check(output)
    campaign = open_campaign(store)
    _emit_table(ensemble_dataset(campaign, _candidate(campaign, candidate), trajectories=trajectories), form, output)


@export.command(
    epilog="\b\nExamples:\n  softclose export runs/a.zarr history > history.csv\n"
    "  softclose export runs/a.zarr history --format parquet -o history.parquet"
)
@click.option("--format", "form", type=click.Choice(["csv", "parquet", "netcdf"]), default="csv", show_default=True)
@output_option
@click.pass_obj
def history(store: str, /, form: str, output: Path | None) -> None:
    """One row per committed candidate: waveform, metrics with intervals, what the surrogate believed."""
    from softclose_store import open_campaign
    from softclose_workflows.exports.tables import history_dataset

    _check(output)
    _emit_table(history_dataset(open_campaign(store)), form, output)


def _candidate(campaign: Campaign, i: int | None) -> int:
    """The candidate asked for, or the best certified one, or the best."""
    from softclose_workflows.analyses.chosen import choose

    return choose(campaign.path, i).candidate


def _comments(campaign: Campaign, i: int, drive: Waveform) -> list[str]:
    from softclose_workflows.tell.tables import describe_waveform

    lines = describe_waveform([list(row) for row in drive.rows()]).splitlines()
    return [
        f"softclose waveform: candidate {i} of {campaign.config['campaign']['name']} ({campaign.fingerprint[:12]})",
        *lines,
    ]


def _check(output: Path | None) -> None:
    """Refuse a place that cannot be written before anything is read."""
    from softclose_workflows.tell.outputs import check_file

    if output is not None and str(output) != "-":
        check_file(output)


def _emit(text: str, output: Path | None) -> None:
    if output is None or str(output) == "-":
        click.echo(text, nl=False)
        return
    from softclose_workflows.tell.outputs import write_text

    write_text(output, text)
    click.echo(f"wrote {output}", err=True)


def _emit_table(dataset: Any, form: str, output: Path | None) -> None:
    from softclose_workflows.errors import ExportError
    from softclose_workflows.exports.tables import write_dataset

    if output is None or str(output) == "-":
        if form != "csv" or len(dataset.sizes) > 1:
            raise ExportError(f"{form} with these options is not text for standard output; give a file (-o)")
        click.echo(dataset.to_dataframe().to_csv(lineterminator="\n"), nl=False)
        return
    write_dataset(dataset, output, form)
    click.echo(f"wrote {output}", err=True)
