"""Owns `softclose resume`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from softclose_workflows.commands.options import break_lock_option, placement_options, quiet_option

if TYPE_CHECKING:
    from softclose_workflows.run.executors import Placement


@click.command(
    epilog="\b\nExamples:\n  softclose resume runs/a.zarr --workers 2\n  softclose resume runs/a.zarr --budget 300"
)
@click.argument("store", metavar="STORE")
@click.option(
    "--budget",
    type=click.IntRange(min=1),
    metavar="N",
    help="Extend the finished campaign to N candidates; those that it has stay as they are.",
)
@click.option(
    "--retry-failed",
    is_flag=True,
    help="Compute the failed candidates of the finished campaign again, as further ones; their records stay.",
)
@placement_options
@break_lock_option
@quiet_option
@click.pass_context
def resume(
    ctx: click.Context,
    store: str,
    budget: int | None,
    retry_failed: bool,
    placement: Placement,
    break_lock: bool,
    quiet: bool,
) -> None:
    """Continue the campaign in STORE from its last committed wave and its finished blocks."""
    from softclose_workflows.commands.driving import drive
    from softclose_workflows.run import extension

    ctx.meta["softclose.store"] = store
    if budget is not None and retry_failed:
        raise click.UsageError("--budget and --retry-failed exclude each other; give one after the other")
    if budget is not None:
        extension.extend(store, budget, break_lock=break_lock)
    if retry_failed:
        extension.retry_failed(store, break_lock=break_lock)
    drive(store, placement, break_lock=break_lock, quiet=quiet)
