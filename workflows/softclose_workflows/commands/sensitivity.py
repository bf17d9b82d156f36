"""Owns `softclose sensitivity`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from softclose_workflows.commands.options import crew_options, quiet_option

if TYPE_CHECKING:
    from softclose_workflows.run.executors import Placement


@click.command(epilog="\b\nExample:\n  softclose sensitivity runs/a.zarr --points 1024")
@click.argument("store", metavar="STORE")
@click.option("--candidate", type=int, help="Candidate [the best certified one, or else the best].")
@click.option("--points", type=int, default=512, show_default=True, help="Points of a replicate, a power of 2.")
@click.option("--replicates", type=int, default=8, show_default=True, help="Independent replicates, for the intervals.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the points.")
@crew_options
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
@quiet_option
def sensitivity(
    store: str,
    candidate: int | None,
    points: int,
    replicates: int,
    seed: int,
    placement: Placement,
    as_json: bool,
    quiet: bool,
) -> None:
    """Show which of D, G, E and T the spread of V and the failures to close come from (Sobol' indices)."""
    from dataclasses import asdict

    from softclose_workflows.analyses.drive_errors import sensitivity as run
    from softclose_workflows.run.crew import open_crew
    from softclose_workflows.tell.console import bar, wide_console
    from softclose_workflows.tell.plain import json_text

    options: Any = {"candidate": candidate, "points": points, "replicates": replicates, "seed": seed}
    with bar("simulating", quiet=quiet) as listener, open_crew(placement) as crew:
        chosen, found = run(store, **options, mapper=crew, listener=listener)
    if as_json:
        whole = {"store": store, "candidate": chosen.candidate, "why": chosen.why, **asdict(found)}
        click.echo(json_text(whole))
        return
    from rich.table import Table

    from softclose_workflows.tell.labels import in_percent

    table = Table(
        title=f"candidate {chosen.candidate} ({chosen.why}): shares of the variance",
        title_justify="left",
        caption=f"{found.n_simulated:,} switches, {in_percent(found.p_contact, 1)} touched, "
        f"{in_percent(found.p_closed, 1)} closed; {in_percent(found.confidence)} intervals",
        caption_justify="left",
    )
    for column in ("of", "from", "by itself", "with interactions"):
        table.add_column(column, justify="left" if column in ("of", "from") else "right")
    names = {"v_cm_s": "V", "closed": "closing"}

    def share(value: float, interval: tuple[float, float]) -> str:
        return "–" if value != value else f"{value:.3f} ({interval[0]:.3f} to {interval[1]:.3f})"

    for i in found.indices:
        table.add_row(names[i.output], i.variable, share(i.first, i.first_interval), share(i.total, i.total_interval))
    wide_console().print(table)
