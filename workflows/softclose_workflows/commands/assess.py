"""Owns `softclose assess`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from softclose_workflows.commands.options import columns_option, crew_options, quiet_option
from softclose_workflows.terminal import say

if TYPE_CHECKING:
    from softclose_workflows.run.executors import Placement


@click.command(
    epilog="\b\nExamples:\n  softclose assess runs/a.zarr scope.csv --scale 20\n"
    "  softclose assess runs/a.zarr scope.csv --columns time_s=Time,volts_V=CH2\n"
    "  softclose assess current-three trace.csv --switches 20000 --json"
)
@click.argument("source", metavar="STORE|PRESET|FILE")
@click.argument("trace", metavar="CSV")
@columns_option("time_us=t1,volts_mV=CH2")
@click.option(
    "--time-unit", type=click.Choice(["s", "ms", "us", "ns"]), help="Of the instants, where the file says none."
)
@click.option(
    "--volt-unit", type=click.Choice(["V", "mV", "kV", "uV"]), help="Of the voltages, where the file says none."
)
@click.option("--shift", "shift_us", type=float, default=0.0, metavar="T_US", help="Added to the instants [µs].")
@click.option(
    "--scale",
    "--gain",
    "scale",
    type=float,
    metavar="FACTOR",
    help="Voltages are multiplied by it: of a probe, a monitor output, or an amplifier whose input was recorded.",
)
@click.option(
    "--max-volts",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="VOLTS",
    help="Highest voltage that the record may reach [that of the campaign].",
)
@click.option(
    "--tolerance",
    "tolerance_volts",
    type=click.FloatRange(min=0.0),
    default=0.0,
    show_default=True,
    metavar="VOLTS",
    help="Samples that lines through the others meet to this are left out; 0: none.",
)
@click.option("--switches", type=int, default=100_000, show_default=True, help="New switches.")
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the new switches [the certificate's].")
@click.option("--keep", "keep_as", metavar="NAME", help="Keep it in STORE, as traces/NAME.")
@crew_options
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
@quiet_option
def assess(
    source: str,
    trace: str,
    columns: str | None,
    time_unit: str | None,
    volt_unit: str | None,
    shift_us: float,
    scale: float | None,
    max_volts: float | None,
    tolerance_volts: float,
    switches: int,
    seed: int | None,
    keep_as: str | None,
    placement: Placement,
    as_json: bool,
    quiet: bool,
) -> None:
    """Judge a drive that you have recorded or drawn, given as a table of instants and voltages.

    From a STORE, the best waveform runs on the same switches, so that the difference has an interval. From a PRESET or
    FILE, only the population and the objective are used.
    """
    from softclose.datafiles import parsed_columns
    from softclose.waveform import read_record
    from softclose.waveform.recorded import COLUMNS
    from softclose_workflows.analyses.assessed_trace import assess_trace, keep
    from softclose_workflows.analyses.certified_tables import comparison_line
    from softclose_workflows.run import records
    from softclose_workflows.run.crew import open_crew
    from softclose_workflows.tell.console import bar
    from softclose_workflows.tell.plain import json_text, waveform_rows
    from softclose_workflows.tell.tables import interval_kinds, print_designs

    record = read_record(
        trace,
        columns=parsed_columns(columns, COLUMNS),
        time_unit=time_unit,
        volt_unit=volt_unit,
        shift_us=shift_us,
        scale=1.0 if scale is None else scale,
    )
    read = record.trace
    drive = read.simplified(tolerance_volts) if tolerance_volts > 0.0 else read
    with bar("assessing", quiet=quiet) as listener, open_crew(placement) as crew:
        found = assess_trace(
            source,
            drive,
            n_switches=switches,
            seed=seed,
            mapper=crew,
            listener=listener,
            max_volts=max_volts,
            scaled=scale is not None,
        )
    kept = None if keep_as is None else keep(source, keep_as, found)
    if as_json:
        click.echo(json_text(found.to_json() | {"kept": kept, "read": record.notes}))
        return
    for note in record.notes:
        say(f"{trace}: {note}")
    rows: list[tuple[str, list[list[float | None]], dict[str, object]]] = [
        (
            f"{trace}\n{len(read.times_us):,} samples, {len(drive.times_us):,} lines, "
            f"up to {drive.max_voltage(found.config.model.horizon_us):.2f} V",
            [],
            records.assessment_record(found.assessment, found.contacts),
        )
    ]
    if found.best is not None and found.best_assessment is not None:
        name = f"candidate {found.best.candidate} ({found.best.why})"
        best = waveform_rows(found.best.waveform.rows())
        rows.append((name, best, records.assessment_record(found.best_assessment, found.best_contacts)))
    kinds = interval_kinds(found.assessment.confidence, switches)
    print_designs(f"On {switches:,} new switches (seed {found.seed})", rows, kinds)
    if found.comparison is not None and found.best is not None:
        say(f"against candidate {found.best.candidate}: {comparison_line(found.comparison)}")
    if kept is not None:
        say(f"kept as {kept} of {source}")
