"""Owns `softclose pareto`."""

from __future__ import annotations

import click


@click.command(
    epilog="\b\nExamples:\n  softclose pareto runs/a.zarr\n"
    "  softclose pareto runs/a.zarr --objective v_u --objective closing --objective peak --json"
)
@click.argument("store", metavar="STORE")
@click.option(
    "--objective",
    "objectives",
    multiple=True,
    metavar="QUANTITY",
    help="What is weighed, repeatable [the campaign's optimiser.objectives]: v_u, p_nc, closing, peak, or a further "
    "quantity that the campaign keeps (objective.lines).",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
def pareto(store: str, objectives: tuple[str, ...], as_json: bool) -> None:
    """List the candidates of STORE that no other beats in all objectives at once, and how the front grew.

    Of those evaluated on the most switches only: scores on fewer switches are more optimistic, and do not compare.
    """
    from softclose_workflows.analyses.front import front_to_json, print_front
    from softclose_workflows.tell.plain import json_text

    chosen = tuple(dict.fromkeys(objectives))
    if as_json:
        click.echo(json_text(front_to_json(store, chosen)))
    else:
        print_front(store, chosen)
