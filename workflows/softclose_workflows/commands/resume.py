"""Owns `softclose resume`."""

from __future__ import annotations

import click

from softclose_workflows.commands.options import break_lock_option, executor_options, quiet_option


@click.command(epilog="\b\nExample:\n  softclose resume runs/a.zarr --workers 2")
@click.argument("store", metavar="STORE")
@executor_options
@break_lock_option
@quiet_option
@click.pass_context
def resume(ctx: click.Context, store: str, workers: int | None, scheduler: str | None, serial: bool,
           break_lock: bool, quiet: bool) -> None:  # fmt: skip
    """Continue the campaign in STORE from its last committed candidate and its finished chunks."""
    from softclose_workflows.drive import drive

    ctx.meta["softclose.store"] = store
    drive(store, workers=workers, scheduler=scheduler, serial=serial, break_lock=break_lock, quiet=quiet)
