"""Owns `softclose tails`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from softclose_workflows.commands.options import crew_options

if TYPE_CHECKING:
    from softclose_workflows.run.executors import Placement

METHODS = ("brute", "form", "sorm", "importance", "subset")


@click.command(
    epilog="\b\nExamples:\n  softclose tails runs/a.zarr --limit 19.7 --limit 23\n"
    "  softclose tails runs/a.zarr --open --method importance --method brute --switches 10000000\n"
    "  softclose tails runs/a.zarr --limit 25 --method brute --json"
)
@click.argument("store", metavar="STORE")
@click.option("--candidate", type=int, metavar="N", help="Which candidate [the best certified one, or else the best].")
@click.option(
    "--limit", "limits", type=float, multiple=True, metavar="CM_S", help="P(V > limit) [the campaign's]; repeatable."
)
@click.option("--open", "open_", is_flag=True, help="Also the probability that a switch stays open.")
@click.option(
    "--method",
    "methods",
    type=click.Choice(METHODS),
    multiple=True,
    help="Which [brute, and all others where OpenTURNS is installed]; repeatable.",
)
@click.option("--switches", type=click.IntRange(min=1), default=1_000_000, show_default=True, help="Of brute force.")
@click.option(
    "--error",
    "relative_error",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=0.05,
    show_default=True,
    help="Coefficient of variation at which importance and subset sampling end.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of all random numbers.")
@crew_options
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
def tails(
    store: str,
    candidate: int | None,
    limits: tuple[float, ...],
    open_: bool,
    methods: tuple[Any, ...],
    switches: int,
    placement: Placement,
    as_json: bool,
    **settings: Any,
) -> None:
    """Estimate rare failures: P(V > limit) and the share left open, by brute force and by reliability methods."""
    from importlib.util import find_spec

    from rich.table import Table

    from softclose.settings import CampaignConfig
    from softclose_store import open_campaign
    from softclose_workflows.analyses.tails import questions, shown, to_json
    from softclose_workflows.analyses.tails import tails as analyse
    from softclose_workflows.run.crew import open_crew
    from softclose_workflows.tell.console import wide_console
    from softclose_workflows.tell.plain import json_text

    config = CampaignConfig.from_dict(open_campaign(store).config)
    asked = questions(limits or config.objective.limits_cm_s, open_)
    with open_crew(placement) as crew:
        chosen, found = analyse(
            store,
            asked,
            candidate=candidate,
            methods=methods or (METHODS if find_spec("openturns") else METHODS[:1]),
            n_switches=switches,
            mapper=crew,
            **settings,
        )
    if as_json:
        click.echo(json_text(to_json(chosen, found)))
        return
    table = Table(
        title=f"candidate {chosen.candidate} ({chosen.why}): rare failures", title_justify="left", show_lines=False
    )
    table.add_column("failure")
    table.add_column("method")
    for column in ("probability", "interval", "switches"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("")
    for question, answers in found:
        for t in answers:
            interval = "" if t.interval[0] != t.interval[0] else f"{shown(t.interval[0])} – {shown(t.interval[1])}"
            table.add_row(question.words, t.method, shown(t.probability), interval, f"{t.n_switches:,}", t.note)
    wide_console().print(table)
