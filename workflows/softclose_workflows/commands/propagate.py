"""Owns `softclose propagate`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from softclose_workflows.commands.options import columns_option, crew_options, quiet_option
from softclose_workflows.terminal import say

if TYPE_CHECKING:
    from softclose_workflows.run.executors import Placement


@click.command(
    epilog="\b\nExamples:\n  softclose propagate runs/mine.zarr measurements.csv\n"
    "  softclose propagate runs/mine.zarr measurements.csv --bounds D=2.3:2.7 --bounds G=3.6:3.9 --lots 500 --json"
)
@click.argument("store", metavar="STORE")
@click.argument("measurements", metavar="CSV")
@columns_option("G_um=gap,D_um=travel")
@click.option("--candidate", type=int, metavar="N", help="Which candidate [the best certified one, or else the best].")
@click.option(
    "--bounds",
    multiple=True,
    metavar="X=LOWER:UPPER",
    help="Bounds of D, G, E or T known from the process; repeatable.",
)
@click.option("--lots", type=int, default=200, show_default=True, help="Lots that the devices may have come from.")
@click.option("--switches", type=click.IntRange(min=100), default=4_000, show_default=True, help="Of each lot.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of devices and switches.")
@click.option("--any-lot", is_flag=True, help="Devices of another lot than the campaign's are taken, and said.")
@crew_options
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
@quiet_option
def propagate(
    store: str,
    measurements: str,
    columns: str | None,
    candidate: int | None,
    bounds: tuple[str, ...],
    lots: int,
    switches: int,
    seed: int,
    any_lot: bool,
    placement: Placement,
    as_json: bool,
    quiet: bool,
) -> None:
    """Show how certain the figures of a waveform in STORE are, given how few devices the lot was fitted to.

    The lot is fitted to the devices of CSV, and to as many others drawn from it, again and again: the
    spread of v_u and p_nc is the uncertainty that comes from having measured few devices. A certificate's interval
    accounts only for how many switches were simulated.
    """
    from softclose.datafiles import parsed_columns
    from softclose.population.measurements import NAMES
    from softclose_workflows.analyses.devices import propagate as run
    from softclose_workflows.analyses.devices import said, to_json
    from softclose_workflows.commands.calibrate import parsed_bounds
    from softclose_workflows.run.crew import open_crew
    from softclose_workflows.tell.console import bar
    from softclose_workflows.tell.plain import json_text

    known = parsed_bounds(bounds)
    with bar("refitting", quiet=quiet) as listener, open_crew(placement) as crew:
        chosen, found, notes = run(
            store,
            measurements,
            columns=parsed_columns(columns, NAMES),
            candidate=candidate,
            bounds=known,
            n_lots=lots,
            n_switches=switches,
            seed=seed,
            any_lot=any_lot,
            mapper=crew,
            listener=listener,
        )
    if as_json:
        click.echo(json_text(to_json(chosen, found, notes)))
        return
    for line in [*notes, *said(chosen, found)]:
        say(line)
