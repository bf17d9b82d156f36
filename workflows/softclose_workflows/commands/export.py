"""Owns `softclose export`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softclose_workflows.commands.options import Command, columns_option
from softclose_workflows.exports.formats import MEANT_FOR, check_meant
from softclose_workflows.terminal import say

if TYPE_CHECKING:
    from softclose_store import Campaign

WRITTEN_FOR_GENERATORS = ("keysight-arb", "tektronix-tfw", "siglent-csv")
"""Formats that are files of particular generators."""


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
    "  softclose export runs/a.zarr waveform --format keysight-arb --gain 20 -o drive.arb\n"
    "  softclose export runs/a.zarr ensemble --format netcdf --trajectories -o best.nc\n"
    "  softclose export runs/a.zarr trim --rows 21 -o scales.csv\n"
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
    "  softclose export runs/a.zarr waveform --release -o drive.csv\n"
    "  softclose export runs/a.zarr waveform --format dac --bits 14 --full-scale 200 -o drive.txt"
)
@click.option(
    "--format",
    type=click.Choice(sorted(MEANT_FOR)),
    default="csv",
    show_default=True,
    help="csv: volts at a sample rate; pwl: a SPICE source; dac: integer codes; the others: files of such generators.",
)
@candidate_option
@click.option(
    "--rate",
    "rate_MSps",
    type=float,
    default=10.0,
    show_default=True,
    metavar="MS/s",
    help="Samples per µs; siglent-csv has 16384 samples in any case.",
)
@click.option("--duration", "duration_us", type=float, metavar="µs", help="Length [the campaign's horizon].")
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
    help="dac: voltage at the switch of the largest code, amplifier included; required.",
)
@click.option(
    "--gain",
    type=float,
    metavar="V/V",
    help="Files of generators: volts at the switch per volt of the generator; required.",
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
@click.option(
    "--max-error",
    "max_error_cm_s",
    type=click.FloatRange(min=0.0, min_open=True),
    default=0.5,
    show_default=True,
    metavar="CM_S",
    help="How far v_u of the delivered samples may be from the waveform's, p_nc a hundredth of it; computed.",
)
@click.option(
    "--release", is_flag=True, help="The whole drive: with the opening that the campaign designed (opening.release_us)."
)
@click.option("--pull-in", "pull_in_V", type=float, metavar="V", help="Trimmed: the switch's measured pull-in voltage.")
@click.option("--resonance", "resonance_kHz", type=float, metavar="kHz", help="Trimmed: its measured resonance.")
@output_option
@click.pass_context
def waveform(
    ctx: click.Context,
    /,
    candidate: int | None,
    output: Path | None,
    **settings: Any,
) -> None:
    """Write the drive waveform of one candidate, scaled for one switch where its measured values are given."""
    from softclose_store import open_campaign
    from softclose_workflows.errors import ExportError
    from softclose_workflows.exports.drive_files import drive_file
    from softclose_workflows.exports.formats import DriveSettings
    from softclose_workflows.tell.outputs import say_written

    _check(output)
    form = settings["format"]
    check_meant(form, _given(ctx))
    if _is_standard(output):
        if form in WRITTEN_FOR_GENERATORS:
            raise ExportError(f"{form} is a file for an instrument; say where to write it (-o)")
        if form == "dac" and not settings["header"]:
            raise ExportError(
                "codes without a header say nothing of their scale; give a file (-o), which FILE.json describes"
            )
    campaign = open_campaign(ctx.obj)
    drive = drive_file(campaign, _candidate(campaign, candidate), DriveSettings(**settings))
    if output is None or _is_standard(output):
        click.echo(drive.content, nl=False)
    else:
        drive.write(output)
        say_written([output, *([f"{output}.json"] if drive.about else [])], err=True)
    for note in drive.notes:
        click.echo(note, err=True)


def _given(ctx: click.Context) -> dict[str, str]:
    """Settings that were typed -> their option."""
    from click.core import ParameterSource

    typed = ParameterSource.COMMANDLINE
    return {str(p.name): p.opts[0] for p in ctx.command.params if ctx.get_parameter_source(str(p.name)) is typed}


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
    """Write every switch of one candidate: its properties and its response."""
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
    """Write one row per committed candidate: waveform, metrics with intervals, what the surrogate predicted."""
    from softclose_store import open_campaign
    from softclose_workflows.exports.tables import history_dataset

    _check(output)
    _emit_table(history_dataset(open_campaign(store)), form, output)


@export.command(
    epilog="\b\nExamples:\n  softclose export runs/a.zarr trim -o scales.csv\n"
    "  softclose export runs/a.zarr trim --rows 21 -o scales.csv"
)
@click.option(
    "--devices",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    metavar="CSV",
    help="Measured devices, with the columns pull_in_V and resonance_kHz as far as they are measured.",
)
@columns_option("pull_in_V=Vpi,device=serial")
@click.option(
    "--rows",
    type=click.IntRange(2, 1000),
    default=41,
    show_default=True,
    help="Without --devices: values of each measured quantity; a campaign with bins has one row a bin.",
)
@candidate_option
@output_option
@click.pass_obj
def trim(
    store: str, /, devices: Path | None, columns: str | None, rows: int, candidate: int | None, output: Path | None
) -> None:
    """Write a table for the test floor: from what is measured on a switch to the scales of its drive."""
    from softclose.settings import CampaignConfig
    from softclose.waveform import Waveform
    from softclose_store import open_campaign
    from softclose_workflows.exports.trim import scales_table

    _check(output)
    campaign = open_campaign(store)
    config = CampaignConfig.from_dict(campaign.config)
    drive = Waveform.from_rows(campaign.waveform(_candidate(campaign, candidate)))
    _emit(scales_table(config, drive, rows=rows, devices=devices, columns=columns), output)


def _candidate(campaign: Campaign, i: int | None) -> int:
    """The candidate asked for, or the best certified one, or the best; said where it leaves many switches open."""
    from softclose_workflows.analyses.chosen import choose

    found = choose(campaign.path, i)
    if found.warning:
        say(found.warning, err=True)
    return found.candidate


def _check(output: Path | None) -> None:
    """Refuse a place that cannot be written before anything is read."""
    from softclose_workflows.tell.outputs import check_file

    if output is not None and not _is_standard(output):
        check_file(output)


def _is_standard(output: Path | None) -> bool:
    """Whether it goes to standard output."""
    return output is None or str(output) == "-"


def _emit(text: str, output: Path | None) -> None:
    if output is None or _is_standard(output):
        click.echo(text, nl=False)
        return
    from softclose_workflows.tell.outputs import say_written, write_text

    write_text(output, text)
    say_written([output], err=True)


def _emit_table(dataset: Any, form: str, output: Path | None) -> None:
    from softclose_workflows.errors import ExportError
    from softclose_workflows.exports.tables import csv_text, write_dataset
    from softclose_workflows.tell.outputs import say_written

    if output is None or _is_standard(output):
        if form != "csv" or len(dataset.sizes) > 1:
            raise ExportError(f"{form} with these options is not text for standard output; give a file (-o)")
        click.echo(csv_text(dataset), nl=False)
        return
    write_dataset(dataset, output, form)
    say_written([output], err=True)
