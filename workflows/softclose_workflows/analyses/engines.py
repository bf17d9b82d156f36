"""Owns the comparison of engines as a command shows it: certified, as a table and as JSON."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import click
import numpy as np

from softclose.propose.side_by_side import EngineRun, compare_engines, with_seed
from softclose.settings import CampaignConfig
from softclose_workflows.analyses.certify import assess_fresh, simulate_fresh
from softclose_workflows.run import needs
from softclose_workflows.tell.console import wide_console
from softclose_workflows.tell.plain import waveform_rows
from softclose_workflows.terminal import silent


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """One engine on one seed, and the truth about its best waveform."""

    run: EngineRun
    """What it found."""
    certified_g_cm_s: float
    """g of its best waveform on new switches [cm/s]; NaN where none were asked for."""


def compare(
    config: CampaignConfig, engines: Sequence[str], seeds: Sequence[int], n_switches: int, *, quiet: bool
) -> list[Compared]:
    """Every engine on every seed; n_switches new switches certify each best waveform."""
    needs.check(
        needs.of_ensemble(config.n_switches_max),
        f"an ensemble of {config.n_switches_max:,} switches",
        "lower population.n_switches",
    )
    needs.check_fresh(n_switches, 1)
    results = []
    for run in compare_engines(config, engines, seeds):
        g = math.nan
        if n_switches:
            own = with_seed(config, run.seed)
            (response,) = simulate_fresh(own, [run.best.waveform], n_switches=n_switches, seed=run.seed)
            g = assess_fresh(response, own).g_cm_s
        results.append(Compared(run=run, certified_g_cm_s=g))
        if not silent(quiet):
            click.echo(f"{run.engine}, seed {run.seed}: g {run.best.g_cm_s:.2f}, certified {g:.2f} cm/s", err=True)
    return results


def to_json(results: Sequence[Compared]) -> dict[str, Any]:
    """Plain values of every run."""
    return {
        "runs": [
            {
                "engine": r.run.engine,
                "seed": r.run.seed,
                "g_cm_s": r.run.best.g_cm_s,
                "certified_g_cm_s": r.certified_g_cm_s,
                "waveform": waveform_rows(r.run.best.waveform.rows()),
                "best_g_cm_s": r.run.best_g_cm_s.tolist(),
                "wall_s": r.run.wall_s.tolist(),
                "propose_s": r.run.propose_s.tolist(),
            }
            for r in results
        ]
    }


def by_engine(results: Sequence[Compared]) -> dict[str, list[Compared]]:
    """Runs grouped by engine, in the order given."""
    groups: dict[str, list[Compared]] = {}
    for r in results:
        groups.setdefault(r.run.engine, []).append(r)
    return groups


def print_comparison(results: Sequence[Compared]) -> None:
    """Median and spread over the seeds, a row per engine."""
    from rich.table import Table

    def spread(values: Sequence[float], digits: int = 2) -> str:
        ordered = sorted(values)
        return f"{statistics.median(ordered):.{digits}f} ({ordered[0]:.{digits}f}–{ordered[-1]:.{digits}f})"

    table = Table(title="median (lowest–highest) over the seeds", title_justify="left")
    table.add_column("engine")
    for column in (
        "seeds",
        "evaluations",
        "g, training [cm/s]",
        "g, certified [cm/s]",
        "time [s]",
        "proposal [s]",
    ):
        table.add_column(column, justify="right", no_wrap=True)
    for engine, runs in by_engine(results).items():
        certified = [r.certified_g_cm_s for r in runs]
        table.add_row(
            engine,
            str(len(runs)),
            str(len(runs[0].run.wall_s)),
            spread([r.run.best.g_cm_s for r in runs]),
            "–" if any(map(math.isnan, certified)) else spread(certified),
            spread([float(r.run.wall_s[-1]) for r in runs], 1),
            spread([float(np.mean(r.run.propose_s)) for r in runs], 3),
        )
    wide_console().print(table)
