"""Owns `softclose status`."""

from __future__ import annotations

import click


@click.command(
    epilog="\b\nExamples:\n  softclose status runs/a.zarr\n  softclose status runs/a.zarr --watch\n"
    "  softclose status runs/a.zarr --json | jq .best.g_cm_s"
)
@click.argument("store", metavar="STORE")
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
@click.option("--where", is_flag=True, help="Where the time of workers and driver went, in all runs that ended.")
@click.option("--watch", is_flag=True, help="Live view until the campaign is finished or Ctrl-C; no terminal: lines.")
@click.option(
    "--interval",
    type=click.FloatRange(min=0.05),
    default=1.0,
    show_default=True,
    metavar="S",
    help="With --watch: seconds between looks at the store.",
)
def status(store: str, as_json: bool, where: bool, watch: bool, interval: float) -> None:
    """Say where the campaign in STORE stands, also while it is being written, here or elsewhere."""
    if watch:
        if as_json:
            raise click.UsageError("--json and --watch exclude each other; scripts call `status --json` again")
        from softclose_workflows.tell.watch import watch as show
        from softclose_workflows.terminal import plain_console

        show(store, interval, plain_console())
        return
    from softclose_workflows.tell.plain import json_text

    if where:
        from softclose_workflows.analyses.where import print_where
        from softclose_workflows.analyses.where import where as look

        spent = look(store)
        if as_json:
            click.echo(json_text(spent.to_json()))
        else:
            print_where(store, spent)
        return
    from softclose_workflows.tell.standing import read_standing

    standing = read_standing(store)
    if as_json:
        click.echo(json_text(standing.to_json()))
        return
    from softclose_workflows.tell.tables import print_standing

    print_standing(standing)
