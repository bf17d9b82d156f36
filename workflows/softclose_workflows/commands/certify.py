"""Owns `softclose certify`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from softclose_workflows.commands.options import crew_options, quiet_option

if TYPE_CHECKING:
    from softclose_workflows.run.executors import Placement


@click.command(
    epilog="\b\nExamples:\n  softclose certify runs/a.zarr\n"
    "  softclose certify runs/a.zarr --switches 1000000 --top 3 --json | jq '.candidates[0].g_cm_s'\n"
    "  softclose certify runs/a.zarr --within 0.05"
)
@click.argument("store", metavar="STORE")
@click.option(
    "--switches",
    type=int,
    default=100_000,
    show_default=True,
    help="New switches; at least as many as STORE was trained on.",
)
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the new switches [the campaign's].")
@click.option("--top", type=int, default=10, show_default=True, help="Best distinct candidates to certify.")
@click.option(
    "--within",
    "within_cm_s",
    type=float,
    metavar="CM_S",
    help="Eliminate losers and double the sample until the winner is certain, or certain to within CM_S; at "
    "most --switches are used.",
)
@click.option("--threads", type=click.IntRange(min=1), help="Threads of this process to simulate with [one per core].")
@click.option(
    "--store-trajectories",
    is_flag=True,
    help="Keep x(t) and v(t) of every new switch under every design in STORE, too, and those of a race (--within).",
)
@crew_options
@click.option("--json", "as_json", is_flag=True, help="One JSON object, for scripts.")
@quiet_option
def certify(
    store: str,
    switches: int,
    seed: int | None,
    top: int,
    within_cm_s: float | None,
    threads: int | None,
    store_trajectories: bool,
    placement: Placement,
    as_json: bool,
    quiet: bool,
) -> None:
    """Rank the best candidates in STORE by what they do on new switches, and keep the result in STORE.

    The new switches are independent of those that the campaign was trained on, so the result is not optimistic.
    Certifications on different numbers of switches are kept side by side; the one on the most switches counts for
    `export`, `report` and `compare`.
    """
    from softclose.settings import CampaignConfig
    from softclose_store import open_campaign
    from softclose_workflows.analyses.certified_tables import certification_to_json, print_certification, print_race
    from softclose_workflows.analyses.certify import N_REFERENCES
    from softclose_workflows.analyses.certify import certify as run
    from softclose_workflows.analyses.drive_off import print_drive_off
    from softclose_workflows.analyses.finalists import certify_within
    from softclose_workflows.analyses.hold import holds_of
    from softclose_workflows.analyses.own_limits import own_limits
    from softclose_workflows.run.crew import open_crew
    from softclose_workflows.run.needs import announced_fresh
    from softclose_workflows.tell.console import bar
    from softclose_workflows.tell.plain import json_text
    from softclose_workflows.terminal import say

    options: Any = {"n_switches": switches, "seed": seed, "top": top, "store_trajectories": store_trajectories}
    race = None
    if store_trajectories and not quiet:
        config = CampaignConfig.from_dict(open_campaign(store).config)
        say(announced_fresh(config, switches, top + N_REFERENCES), err=True)
    with bar("certifying", quiet=quiet) as listener, open_crew(placement, threads=threads, store=store) as crew:
        if within_cm_s is None:
            result = run(store, **options, mapper=crew, listener=listener)
        else:
            result, race = certify_within(store, within_cm_s, **options, mapper=crew, listener=listener)
        config = CampaignConfig.from_dict(open_campaign(store).config)
        holds = holds_of(config, result, mapper=crew)
    limits = own_limits(config, result.best.response, result.best.assessment, fresh=True)
    if as_json:
        raced = {} if race is None else {"race": race.to_dict()}
        click.echo(json_text(certification_to_json(result, holds, limits) | raced))
        return
    print_certification(result, holds, limits)
    print_drive_off(result.drive_off, result.n_switches)
    if race is not None:
        print_race(race)
