"""Owns `softclose reproduce`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softclose_workflows.commands.options import placement_options, quiet_option

if TYPE_CHECKING:
    from softclose_workflows.run.executors import Placement


@click.command(
    epilog="\b\nExamples:\n  softclose reproduce --out runs/study\n  softclose reproduce --out runs/quick --quick"
)
@click.option("--out", default="runs/reproduce", show_default=True, metavar="DIR", help="Folder of stores and results.")
@click.option("--quick", is_flag=True, help="Small budgets and ensembles: a smoke test, not a result.")
@click.option("--switches", type=click.IntRange(min=1), help="New switches of each certification [100,000].")
@click.option("--set", "overrides", multiple=True, metavar="SECTION.KEY=VALUE", help="Override a setting of all.")
@placement_options
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
@quiet_option
def reproduce(
    out: str,
    quick: bool,
    switches: int | None,
    overrides: tuple[str, ...],
    placement: Placement,
    as_json: bool,
    quiet: bool,
) -> None:
    """Reproduce the published study: every design optimised, certified, and set beside the printed figures.

    Stopped or killed, the same command continues; what is finished is not computed again.
    """
    from softclose_workflows.figures.reproduction import draw_all
    from softclose_workflows.studies.reproduce import QUICK, QUICK_SWITCHES, print_reproduction, to_json
    from softclose_workflows.studies.reproduce import reproduce as run
    from softclose_workflows.studies.series import Effort
    from softclose_workflows.tell.plain import json_text

    started = time.monotonic()
    effort = Effort(
        n_switches=switches or (QUICK_SWITCHES if quick else 100_000),
        top=3 if quick else 10,
        placement=placement,
        quiet=quiet or as_json,
    )
    rows = run(out, effort, (*(QUICK if quick else ()), *overrides))
    draw_all(Path(out) / "figures", rows)
    if as_json:
        click.echo(json_text(to_json(rows)))
        return
    print_reproduction(rows)
    click.echo(f"{out}: table.txt, table.json, figures, stores; {time.monotonic() - started:.0f} s in this run")
