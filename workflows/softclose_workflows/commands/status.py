"""Owns `softclose status`."""

from __future__ import annotations

import json

import click


@click.command(
    epilog="\b\nExamples:\n  softclose status runs/a.zarr\n  softclose status runs/a.zarr --json | jq .best.g_cm_s"
)
@click.argument("store", metavar="STORE")
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
def status(store: str, as_json: bool) -> None:
    """Say where the campaign in STORE stands, also while it is being written."""
    from softclose_workflows.standing import read_standing

    standing = read_standing(store)
    if as_json:
        click.echo(json.dumps(standing.to_json(), indent=2))
        return
    from softclose_workflows.tables import print_standing

    print_standing(standing)
