"""Owns `softclose run`."""

from __future__ import annotations

import click

from softclose_workflows.commands.options import break_lock_option, executor_options, quiet_option


@click.command(
    epilog="\b\nExamples:\n  softclose run current --store runs/a.zarr\n"
    "  softclose run current --store runs/b.zarr --set campaign.seed=7 --set population.n_switches=5000"
)
@click.argument("source", metavar="PRESET|FILE")
@click.option("--store", required=True, metavar="PATH", help="Where the campaign is kept: a path or a URL.")
@click.option("--set", "overrides", multiple=True, metavar="SECTION.KEY=VALUE", help="Override a setting; repeatable.")
@executor_options
@break_lock_option
@quiet_option
@click.pass_context
def run(ctx: click.Context, source: str, store: str, overrides: tuple[str, ...], workers: int | None,
        scheduler: str | None, serial: bool, break_lock: bool, quiet: bool) -> None:  # fmt: skip
    """Run the campaign of a shipped preset or of a TOML file.

    If STORE already holds this very campaign it is continued; another campaign is refused.
    """
    from softclose.config import load_config
    from softclose_workflows.drive import create_store, drive
    from softclose_workflows.presets import find_preset

    config = load_config(find_preset(source), overrides)
    create_store(config, store)
    ctx.meta["softclose.store"] = store
    drive(store, workers=workers, scheduler=scheduler, serial=serial, break_lock=break_lock, quiet=quiet)
