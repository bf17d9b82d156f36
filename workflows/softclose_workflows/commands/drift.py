"""Owns `softclose drift`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softclose_workflows.commands.options import crew_options, quiet_option

if TYPE_CHECKING:
    from softclose_workflows.run.executors import Placement

KINDS = ("stiffness", "charge")


@click.command(
    epilog="\b\nExamples:\n  softclose drift runs/a.zarr\n"
    "  softclose drift runs/a.zarr --kind charge --at -4 --at 4 --figure drift.svg"
)
@click.argument("store", metavar="STORE")
@click.option("--candidate", type=int, metavar="N", help="Which candidate [the best certified one, or else the best].")
@click.option(
    "--kind",
    type=click.Choice(KINDS),
    default="stiffness",
    show_default=True,
    help="stiffness: pull-in voltages change by a part; charge: by so many volts.",
)
@click.option(
    "--at", "values", type=float, multiple=True, metavar="DRIFT", help="A part such as 0.02, or volts; repeatable."
)
@click.option("--switches", type=click.IntRange(min=100), default=20_000, show_default=True, help="New switches.")
@click.option("--figure", type=click.Path(path_type=Path), metavar="FILE", help="Draw it (.svg, .png or .pdf).")
@crew_options
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
@quiet_option
def drift(
    store: str,
    candidate: int | None,
    kind: Any,
    values: tuple[float, ...],
    switches: int,
    placement: Placement,
    figure: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Show how far pull-in voltages may drift before v_u of a waveform in STORE has doubled.

    The waveform stays; the switches are those of the certification, as many of them as asked for.
    """
    from softclose_workflows.analyses.drift import drift as analyse
    from softclose_workflows.analyses.drift import print_drift, to_json
    from softclose_workflows.figures.drifting import draw_drift
    from softclose_workflows.figures.saving import check_figure, save
    from softclose_workflows.figures.style import style
    from softclose_workflows.run.crew import open_crew
    from softclose_workflows.tell.console import bar
    from softclose_workflows.tell.plain import json_text

    if figure is not None:
        check_figure(figure)
    with bar("drifting", quiet=quiet) as listener, open_crew(placement) as crew:
        chosen, found = analyse(
            store, kind, values, candidate=candidate, n_switches=switches, mapper=crew, listener=listener
        )
    if figure is not None:
        with style():
            save(draw_drift(found, f"candidate {chosen.candidate} of {Path(store).name}"), figure)
    if as_json:
        click.echo(json_text(to_json(chosen, found)))
    else:
        print_drift(chosen, found, switches)
