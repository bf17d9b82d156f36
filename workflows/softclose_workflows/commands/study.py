"""Owns `softclose study`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from softclose_workflows.commands.options import placement_options, quiet_option

if TYPE_CHECKING:
    from softclose_workflows.run.executors import Placement


@click.command(
    epilog="\b\nShipped studies: restitution, repeatability, design-change, c1, u-max,\n"
    "  trim-error, trim-bins, yield\n\n"
    "\b\nExamples:\n"
    "  softclose study restitution --out runs/restitution\n"
    "  softclose study trim-error --out runs/trim --figure worth.svg --beside runs/improved.zarr\n"
    "  softclose study mine.toml --out runs/mine --set campaign.budget=60 --json"
)
@click.argument("source", metavar="NAME|FILE")
@click.option("--out", required=True, metavar="DIR", help="Folder of the stores, one per value.")
@click.option("--set", "overrides", multiple=True, metavar="SECTION.KEY=VALUE", help="Override a setting of all.")
@click.option("--switches", type=click.IntRange(min=1), default=100_000, show_default=True, help="New switches.")
@click.option("--top", type=click.IntRange(min=1), default=10, show_default=True, help="Candidates certified in each.")
@click.option(
    "--at-once",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Campaigns at a time, on the same workers.",
)
@click.option("--figure", type=click.Path(path_type=Path), metavar="FILE", help="Draw it (.svg, .png or .pdf).")
@click.option(
    "--beside",
    multiple=True,
    metavar="STORE",
    help="In the figure: a certified campaign to compare with, as a line across. Repeatable.",
)
@placement_options
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
@quiet_option
def study(
    source: str,
    out: str,
    overrides: tuple[str, ...],
    switches: int,
    top: int,
    at_once: int,
    figure: Path | None,
    beside: tuple[str, ...],
    placement: Placement,
    as_json: bool,
    quiet: bool,
) -> None:
    """Run a campaign for every value of one parameter, certify each, and try every optimum under every value.

    Stopped or killed, the same command continues; what is finished is not computed again.
    """
    from softclose_workflows.figures.saving import check_figure, save
    from softclose_workflows.figures.studying import draw_study, other
    from softclose_workflows.figures.style import style
    from softclose_workflows.studies.series import Effort
    from softclose_workflows.studies.study import print_study, run_study
    from softclose_workflows.studies.study_file import load_study
    from softclose_workflows.tell.plain import json_text

    if figure is not None:
        check_figure(figure)
    others = [other(path) for path in beside]
    effort = Effort(
        n_switches=switches,
        top=top,
        placement=placement,
        at_once=at_once,
        quiet=quiet or as_json,
    )
    result = run_study(load_study(source, overrides), out, effort)
    if figure is not None:
        with style():
            save(draw_study(result, others), figure)
    if as_json:
        click.echo(json_text(result.to_json()))
    else:
        print_study(result)
