"""Owns `softclose export`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softclose_workflows.commands.options import Command, columns_option
from softclose_workflows.terminal import say

if TYPE_CHECKING:
    from softclose.waveform import Waveform
    from softclose_store import Campaign

WRITTEN_FOR_GENERATORS = ("keysight-arb", "tektronix-tfw", "siglent-csv")
"""Formats that are files of particular generators."""

OPTIONS = {
    "csv": {"rate_MSps", "duration_us"},
    "pwl": {"tolerance_mV", "source", "nodes"},
    "dac": {"rate_MSps", "duration_us", "bits", "full_scale_V", "signed", "header"},
    "keysight-arb": {"rate_MSps", "duration_us", "gain"},
    "tektronix-tfw": {"rate_MSps", "duration_us", "gain"},
    "siglent-csv": {"duration_us", "gain"},
}
"""Format of a waveform -> the options that mean something for it; any other one that is given is refused."""


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
    "form",
    type=click.Choice(sorted(OPTIONS)),
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
    "most_cm_s",
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
    form: str,
    candidate: int | None,
    release: bool,
    pull_in_V: float | None,
    resonance_kHz: float | None,
    output: Path | None,
    **settings: Any,
) -> None:
    """Write the drive waveform of one candidate, scaled for one switch where its measured values are given."""
    from softclose.waveform import Waveform
    from softclose_store import open_campaign

    _check(output)
    _refuse_options_of_other_formats(ctx, form)
    store = ctx.obj
    campaign = open_campaign(store)
    i = _candidate(campaign, candidate)
    drive = _whole(store, i) if release else Waveform.from_rows(campaign.waveform(i))
    if release and settings["duration_us"] is None and form != "pwl":
        settings["duration_us"] = math.ceil(drive.breakpoints(math.inf)[-1])
    if pull_in_V is not None or resonance_kHz is not None:
        from softclose.settings import CampaignConfig
        from softclose_workflows.exports.trim import drive_of

        config = CampaignConfig.from_dict(campaign.config)
        drive, scales = drive_of(config, drive, pull_in_V=pull_in_V, resonance_kHz=resonance_kHz)
        click.echo(f"volts × {float(scales.volts[0]):.4f}, times × {float(scales.times[0]):.4f}", err=True)
    if form == "pwl":
        from softclose_workflows.exports.pwl import draw, spice_source

        line = draw(drive, settings["tolerance_mV"] * 1e-3)
        _check_delivered(campaign, drive, line.times_us, line.volts, settings)
        text = spice_source(
            line, source=settings["source"], nodes=settings["nodes"], comments=_comments(campaign, i, drive)
        )
        _emit(text, output)
        return
    from softclose_workflows.exports.samples import sample_times_us, volts_csv

    if form in WRITTEN_FOR_GENERATORS:
        _emit_instrument(campaign, i, drive, form, settings, output)
        return
    duration = settings["duration_us"] or campaign.config["model"]["horizon_us"]
    if settings["duration_us"] == 0.0:
        duration = 0.0  # refused below, with the value that was given
    times = sample_times_us(settings["rate_MSps"], duration)
    if form == "csv":
        _check_delivered(campaign, drive, times, drive.voltage(times), settings)
        _emit(volts_csv(drive, times), output)
    else:
        _emit_codes(campaign, i, drive, times, settings, output)


def _emit_codes(
    campaign: Campaign, i: int, drive: Waveform, times: Any, settings: dict[str, Any], output: Path | None
) -> None:
    from softclose_workflows.errors import ExportError
    from softclose_workflows.exports.samples import CodeScale, codes_text, metadata
    from softclose_workflows.tell.plain import json_text

    full_scale = settings["full_scale_V"]
    if full_scale is None:
        raise ExportError(
            "codes mean nothing without the voltage at the switch that the largest one stands for, amplifier included: "
            f"give --full-scale (the campaign's limit is {campaign.config['waveform']['max_volts']:g} V)"
        )
    scale = CodeScale(
        bits=settings["bits"],
        signed=settings["signed"],
        rate_MSps=settings["rate_MSps"],
        full_scale_V=full_scale,
    )
    if output is None and not settings["header"]:
        raise ExportError(
            "codes without a header say nothing of their scale; give a file (-o), which FILE.json describes"
        )
    volts = drive.voltage(times)
    codes = scale.encode(volts)
    _check_delivered(campaign, drive, times, codes * scale.volts_per_code, settings)
    about = metadata(scale, codes, volts)
    comments = [*_comments(campaign, i, drive), *(f"{name}: {value}" for name, value in about.items())]
    text = codes_text(codes, comments if settings["header"] else [])
    if output is not None:  # the description first: codes never lie about without their scale
        about |= {"candidate": i, "fingerprint": campaign.fingerprint, "warning": _warning(campaign, i)}
        _emit(json_text(about) + "\n", output.with_name(output.name + ".json"))
    _emit(text, output)


def _emit_instrument(
    campaign: Campaign, i: int, drive: Waveform, form: str, settings: dict[str, Any], output: Path | None
) -> None:
    import json

    import numpy as np

    from softclose_workflows.errors import ExportError
    from softclose_workflows.exports.instruments import SIGLENT_POINTS, WRITERS, play, write_bytes

    if output is None:
        raise ExportError(f"{form} is a file for an instrument; say where to write it (-o)")
    horizon = float(campaign.config["model"]["horizon_us"])
    duration = horizon if settings["duration_us"] is None else settings["duration_us"]
    rate = settings["rate_MSps"]
    if form == "siglent-csv" and duration > 0.0:
        rate = (SIGLENT_POINTS - 1) / duration
    gain = settings["gain"]
    played = play(drive, rate_MSps=rate, duration_us=duration, gain=gain)
    content = WRITERS[form](played)
    _check_delivered(campaign, drive, np.arange(played.volts.size) / played.rate_MSps, played.volts * gain, settings)
    about = {"format": form, **played.settings(), "candidate": i, "fingerprint": campaign.fingerprint}
    about["warning"] = _warning(campaign, i)
    _emit(json.dumps(about, indent=2) + "\n", output.with_name(output.name + ".json"))
    write_bytes(output, content)
    say(f"wrote {output}", err=True)
    click.echo(
        f"at the generator: low level {played.low_V:g} V, high level {played.high_V:.6g} V, "
        f"one period of {played.volts.size / played.rate_MSps:.6g} µs ({about['frequency_Hz']:.6g} Hz)",
        err=True,
    )


def _check_delivered(campaign: Campaign, drive: Waveform, times: Any, volts: Any, settings: dict[str, Any]) -> None:
    from softclose.settings import CampaignConfig
    from softclose_workflows.exports.delivered import check_delivered

    config = CampaignConfig.from_dict(campaign.config)
    check_delivered(config, drive, times, volts, most_cm_s=settings["most_cm_s"])


def _refuse_options_of_other_formats(ctx: click.Context, form: str) -> None:
    from click.core import ParameterSource

    from softclose_workflows.errors import ExportError

    of_formats = set().union(*OPTIONS.values())
    for option in ctx.command.params:
        name = str(option.name)
        if name in of_formats - OPTIONS[form] and ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            meant = ", ".join(sorted(f for f, names in OPTIONS.items() if name in names))
            raise ExportError(f"{option.opts[0]} has no meaning for --format {form}; it belongs to {meant}")


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
    from softclose.datafiles import parsed_columns
    from softclose.population.measurements import NAMES
    from softclose.settings import CampaignConfig
    from softclose.waveform import Waveform
    from softclose_store import open_campaign
    from softclose_workflows.exports.trim import device_table, grid_table

    _check(output)
    campaign = open_campaign(store)
    config = CampaignConfig.from_dict(campaign.config)
    drive = Waveform.from_rows(campaign.waveform(_candidate(campaign, candidate)))
    if devices is None:
        _emit(grid_table(config, drive, rows), output)
    else:
        _emit(device_table(config, drive, devices, parsed_columns(columns, NAMES)), output)


def _whole(store: str, i: int) -> Waveform:
    """Closing, holding, release and brake."""
    from softclose_workflows.errors import ExportError
    from softclose_workflows.run.opening import designed_opening

    found = designed_opening(store, i)
    if found is None:
        raise ExportError(f"{store} designs no opening (opening.release_us): leave --release out")
    return (found.plain if found.braked is None else found.braked).released.waveform


def _candidate(campaign: Campaign, i: int | None) -> int:
    """The candidate asked for, or the best certified one, or the best; said where it leaves many switches open."""
    from softclose_workflows.analyses.chosen import choose

    found = choose(campaign.path, i)
    if found.warning:
        say(found.warning, err=True)
    return found.candidate


def _warning(campaign: Campaign, i: int) -> str:
    """What a file says where its waveform leaves many switches open; else ""."""
    from softclose_workflows.analyses.chosen import choose

    return choose(campaign.path, i).warning


def _comments(campaign: Campaign, i: int, drive: Waveform) -> list[str]:
    from softclose_workflows.exports.tables import cell
    from softclose_workflows.tell.tables import describe_waveform

    lines = describe_waveform([list(row) for row in drive.rows()]).splitlines()
    name = cell(campaign.config["campaign"]["name"])  # one line: in a netlist a line of its own could be a command
    return [
        f"softclose waveform: candidate {i} of {name} ({campaign.fingerprint[:12]})",
        *filter(None, [_warning(campaign, i)]),
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
    say(f"wrote {output}", err=True)


def _emit_table(dataset: Any, form: str, output: Path | None) -> None:
    from softclose_workflows.errors import ExportError
    from softclose_workflows.exports.tables import csv_text, write_dataset

    if output is None or str(output) == "-":
        if form != "csv" or len(dataset.sizes) > 1:
            raise ExportError(f"{form} with these options is not text for standard output; give a file (-o)")
        click.echo(csv_text(dataset), nl=False)
        return
    write_dataset(dataset, output, form)
    say(f"wrote {output}", err=True)
