"""Owns `softclose opening`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from softclose_workflows.commands.options import crew_options, quiet_option

if TYPE_CHECKING:
    from softclose_workflows.run.executors import Placement


@click.command(
    epilog="\b\nExamples:\n  softclose opening runs/a.zarr\n"
    "  softclose opening runs/a.zarr --at 400 --brake 300 --figure opening.svg"
)
@click.argument("store", metavar="STORE")
@click.option("--candidate", type=int, metavar="N", help="Which candidate [the best certified one, or else the best].")
@click.option("--at", "at_us", type=float, metavar="US", help="Begin of the fall [opening.release_us, or the horizon].")
@click.option(
    "--brake",
    type=click.IntRange(min=0, max=100_000),
    default=0,
    show_default=True,
    metavar="N",
    help="Design a braking pulse, with so many waveforms tried; 0: the campaign's own, if it has one.",
)
@click.option(
    "--watch",
    "watch_us",
    type=float,
    metavar="US",
    help="How long to simulate after the fall begins [opening.watch_us].",
)
@click.option("--switches", type=click.IntRange(min=100), default=10_000, show_default=True, help="New switches.")
@click.option("--figure", type=click.Path(path_type=Path), metavar="FILE", help="Draw it (.svg, .png or .pdf).")
@crew_options
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
@quiet_option
def opening(
    store: str,
    candidate: int | None,
    at_us: float | None,
    brake: int,
    watch_us: float | None,
    switches: int,
    figure: Path | None,
    placement: Placement,
    as_json: bool,
    quiet: bool,
) -> None:
    """Show how the switches in STORE open at release: overshoot, contacts after release, time to rest; design a brake.

    This is based on the switches of the certificate that are still closed when the fall begins.
    """
    from softclose_workflows.analyses.opening import opening as analyse
    from softclose_workflows.analyses.opening import openings_to_json, print_openings
    from softclose_workflows.figures.opening import draw_opening
    from softclose_workflows.figures.saving import check_figure, save
    from softclose_workflows.figures.style import style
    from softclose_workflows.run.crew import open_crew
    from softclose_workflows.tell.console import bar
    from softclose_workflows.tell.plain import json_text

    if figure is not None:
        check_figure(figure)
    with bar("opening", quiet=quiet) as listener, open_crew(placement, store=store) as crew:
        found = analyse(
            store,
            at_us=at_us,
            candidate=candidate,
            brake=brake,
            watch_us=watch_us,
            n_switches=switches,
            mapper=crew,
            listener=listener,
        )
    openings = found.openings
    if figure is not None:
        with style():
            save(draw_opening(openings, f"candidate {found.chosen.candidate} of {Path(store).name}"), figure)
    if as_json:
        click.echo(json_text({"candidate": found.chosen.candidate, **openings_to_json(openings)}))
    else:
        title = (
            f"candidate {found.chosen.candidate} ({found.chosen.why}), let go at {openings.at_us:g} µs: "
            f"{openings.plain.n:,} switches that were held"
        )
        print_openings(title, openings, found.chosen.config.objective.level)
