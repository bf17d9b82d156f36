"""Owns `softclose bench`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from softclose.metrics.objective import Assessment

_store = click.argument("store", metavar="STORE")
_candidate = click.argument("candidate", metavar="CANDIDATE", type=click.IntRange(min=0))
_readings = click.argument("readings", metavar="CSV")
_reason = click.option("--reason", required=True, metavar="TEXT", help="Why, for the record.")
_unusual = click.option("--unusual", is_flag=True, help="Take speeds that are far from what this lot can reach.")


@click.group(
    epilog="\b\nExamples:\n  softclose bench ask runs/bench.zarr\n  softclose bench tell runs/bench.zarr 4 speeds.csv\n"
    '  softclose bench withdraw runs/bench.zarr 3 --device 7 --reason "probe slipped"'
)
def bench() -> None:
    """Run a campaign whose responses are measured, begun from Python by `api.Bench`: ask, tell, put right.

    A table of readings has one device a line, always in the same order, and columns `speed_cm_s` (empty: none) and
    `closed` (yes or no). A device with neither was not read.
    """


@bench.command(epilog="\b\nExample:\n  softclose bench ask runs/bench.zarr --json")
@_store
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
def ask(store: str, as_json: bool) -> None:
    """Say which waveform to measure next: the same one until it is told."""
    from softclose_workflows.bench.session import Bench
    from softclose_workflows.tell.plain import json_text, waveform_rows
    from softclose_workflows.tell.tables import describe_waveform

    with Bench(store) as session:
        asked = session.ask()
    rows = waveform_rows(asked.waveform.rows())
    if as_json:
        click.echo(json_text({"candidate": asked.candidate, "n_devices": asked.n_devices, "waveform": rows}))
        return
    click.echo(f"candidate {asked.candidate}, on {asked.n_devices} devices")
    click.echo(describe_waveform(rows))


@bench.command(
    epilog="\b\nExamples:\n  softclose bench tell runs/bench.zarr 4 speeds.csv\n"
    '  softclose bench tell runs/bench.zarr 5 speeds.csv --waveform mine.json --reason "a guess"'
)
@_store
@_candidate
@_readings
@click.option(
    "--waveform",
    metavar="JSON",
    help="What was applied in its place: a file with rows of start, rise, peak [µs] (null: holds) and volts, or what "
    "`bench ask --json` prints.",
)
@click.option("--reason", default="", metavar="TEXT", help="Why it was chosen, for the record.")
@_unusual
def tell(store: str, candidate: int, readings: str, waveform: str | None, reason: str, unusual: bool) -> None:
    """Write down what was measured of CANDIDATE, as `bench ask` named it."""
    from softclose_workflows.bench.readings_file import read_readings
    from softclose_workflows.bench.session import Bench
    from softclose_workflows.bench.waveform_file import read_waveform

    read = read_readings(readings)
    applied = None if waveform is None else read_waveform(waveform)
    with Bench(store) as session:
        told = session.tell(
            candidate,
            read.speeds_cm_s,
            read.closed,
            status=read.status,
            unusual=unusual,
            waveform=applied,
            reason=reason,
        )
    click.echo(f"candidate {candidate}: {_said(told)}")


@bench.command(
    epilog='\b\nExample:\n  softclose bench correct runs/bench.zarr 3 again.csv --reason "vibrometer recalibrated"'
)
@_store
@_candidate
@_readings
@_reason
@_unusual
def correct(store: str, candidate: int, readings: str, reason: str, unusual: bool) -> None:
    """Write other readings of CANDIDATE in place of those that were told, which are kept."""
    from softclose_workflows.bench.readings_file import read_readings
    from softclose_workflows.bench.session import Bench

    read = read_readings(readings)
    with Bench(store) as session:
        told = session.correct(
            candidate, read.speeds_cm_s, read.closed, status=read.status, unusual=unusual, reason=reason
        )
    click.echo(f"candidate {candidate}, corrected: {_said(told)}")


@bench.command(
    epilog='\b\nExamples:\n  softclose bench withdraw runs/bench.zarr 3 --reason "wrong wafer"\n'
    '  softclose bench withdraw runs/bench.zarr 3 --device 7 --device 8 --reason "probe slipped"'
)
@_store
@_candidate
@click.option(
    "--device",
    "devices",
    multiple=True,
    type=click.IntRange(min=0),
    metavar="N",
    help="A device by its place in the order, from 0; repeatable. By default all.",
)
@_reason
def withdraw(store: str, candidate: int, devices: tuple[int, ...], reason: str) -> None:
    """Make readings of CANDIDATE count as missing; what was told is kept."""
    from softclose_workflows.bench.session import Bench

    with Bench(store) as session:
        left = session.withdraw(candidate, devices or None, reason=reason)
    said = "nothing is left, it counts as failed" if left is None else _said(left)
    click.echo(f"candidate {candidate}, readings withdrawn: {said}")


def _said(told: Assessment) -> str:
    return f"g {told.g_cm_s:.2f} cm/s, {100.0 * told.p_nc:.1f} % of {told.n} devices left open"
