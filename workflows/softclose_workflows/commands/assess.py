"""Owns `softclose assess`."""

from __future__ import annotations

import click

from softclose_workflows.commands.options import quiet_option


@click.command(
    epilog="\b\nExamples:\n  softclose assess runs/a.zarr scope.csv --time-unit s --gain 20\n"
    "  softclose assess current-three trace.csv --switches 20000 --json"
)
@click.argument("source", metavar="STORE|PRESET|FILE")
@click.argument("trace", metavar="CSV")
@click.option(
    "--time-unit", type=click.Choice(["s", "ms", "us", "ns"]), help="Of the first column, where its heading says none."
)
@click.option("--shift", "shift_us", type=float, default=0.0, metavar="T_US", help="Added to the instants [µs].")
@click.option("--gain", type=float, default=1.0, show_default=True, help="Volts are multiplied by it.")
@click.option(
    "--tolerance",
    "tolerance_volts",
    type=click.FloatRange(min=0.0),
    default=1e-3,
    show_default=True,
    metavar="VOLTS",
    help="Samples that lines through the others meet to this are left out.",
)
@click.option("--switches", type=int, default=100_000, show_default=True, help="Fresh switches.")
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the fresh switches [the certificate's].")
@click.option("--keep", "keep_as", metavar="NAME", help="Keep it in STORE, as traces/NAME.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
@quiet_option
def assess(
    source: str,
    trace: str,
    time_unit: str | None,
    shift_us: float,
    gain: float,
    tolerance_volts: float,
    switches: int,
    seed: int | None,
    keep_as: str | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """What a lot does under a drive that you have recorded or drawn, as a CSV file of instants and volts.

    Of a STORE the best waveform runs on the same switches, so that the difference has an interval; of a PRESET or a
    FILE lot and objective are taken.
    """
    from softclose.waveform import read_trace
    from softclose_workflows.analyses.assessed_trace import assess_trace, keep
    from softclose_workflows.analyses.certified_tables import comparison_line
    from softclose_workflows.run import records
    from softclose_workflows.run.executors.placement import n_cores
    from softclose_workflows.tell.console import bar
    from softclose_workflows.tell.plain import json_text, waveform_rows
    from softclose_workflows.tell.tables import interval_kinds, print_designs

    read = read_trace(trace, time_unit=time_unit, shift_us=shift_us, gain=gain)
    drive = read.simplified(tolerance_volts) if tolerance_volts > 0.0 else read
    with bar("assessing", quiet=quiet) as listener:
        found = assess_trace(source, drive, n_switches=switches, seed=seed, threads=n_cores(), listener=listener)
    kept = None if keep_as is None else keep(source, keep_as, found)
    if as_json:
        click.echo(json_text(found.to_json() | {"kept": kept}))
        return
    rows: list[tuple[str, list[list[float | None]], dict[str, object]]] = [
        (
            f"{trace}\n{len(read.times_us):,} samples, {len(drive.times_us):,} lines, "
            f"up to {drive.max_voltage(found.config.model.horizon_us):.2f} V",
            [],
            records.assessment_record(found.assessment),
        )
    ]
    if found.best is not None and found.best_assessment is not None:
        name = f"candidate {found.best.candidate} ({found.best.why})"
        best = waveform_rows(found.best.waveform.rows())
        rows.append((name, best, records.assessment_record(found.best_assessment)))
    kinds = interval_kinds(found.assessment.confidence, switches)
    print_designs(f"On {switches:,} fresh switches (seed {found.seed})", rows, kinds)
    if found.comparison is not None and found.best is not None:
        click.echo(f"against candidate {found.best.candidate}: {comparison_line(found.comparison)}")
    if kept is not None:
        click.echo(f"kept as {kept} of {source}")
