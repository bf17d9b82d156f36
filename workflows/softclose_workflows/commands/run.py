"""Owns `softclose run`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from softclose_workflows.commands.options import break_lock_option, placement_options, quiet_option
from softclose_workflows.terminal import say

if TYPE_CHECKING:
    from softclose_workflows.run.executors import Placement


@click.command(
    epilog="\b\nExamples:\n  softclose run current --store runs/a.zarr\n"
    "  softclose run current --store runs/b.zarr --set campaign.seed=7 --set population.n_switches=5000"
)
@click.argument("source", metavar="PRESET|FILE")
@click.option("--store", required=True, metavar="PATH", help="Where the campaign is kept: a path or a URL.")
@click.option("--set", "overrides", multiple=True, metavar="SECTION.KEY=VALUE", help="Override a setting; repeatable.")
@click.option("--dry-run", is_flag=True, help="Say what it would take: waves, bytes, minutes.")
@placement_options
@break_lock_option
@quiet_option
@click.pass_context
def run(
    ctx: click.Context,
    source: str,
    store: str,
    overrides: tuple[str, ...],
    dry_run: bool,
    placement: Placement,
    break_lock: bool,
    quiet: bool,
) -> None:
    """Run the campaign of a shipped preset or of a TOML file.

    If STORE already holds this very campaign it is continued; another campaign is refused.
    """
    from softclose.settings import load_config
    from softclose_workflows.analyses.forewarned import forewarnings
    from softclose_workflows.commands.driving import drive
    from softclose_workflows.run.warm_start import warm_started
    from softclose_workflows.terminal import READING, working

    with working(READING, quiet=quiet):
        config = warm_started(load_config(source, overrides))
    for line in forewarnings(config):
        say(f"note: {line}", err=True)
    if dry_run:
        from softclose_workflows.analyses.dry_run import dry_run as explain

        for line in explain(config, placement):
            say(line)
        return
    ctx.meta["softclose.store"] = store
    drive(store, placement, config=config, break_lock=break_lock, quiet=quiet)
