"""Owns `softclose resume`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from softclose_workflows.commands.options import break_lock_option, placement_options, quiet_option

if TYPE_CHECKING:
    from softclose_workflows.run.executors import Placement


@click.command(epilog="\b\nExample:\n  softclose resume runs/a.zarr --workers 2")
@click.argument("store", metavar="STORE")
@placement_options
@break_lock_option
@quiet_option
@click.pass_context
def resume(ctx: click.Context, store: str, placement: Placement, break_lock: bool, quiet: bool) -> None:
    """Continue the campaign in STORE from its last committed wave and its finished blocks."""
    from softclose_workflows.commands.driving import drive

    ctx.meta["softclose.store"] = store
    drive(store, placement, break_lock=break_lock, quiet=quiet)
