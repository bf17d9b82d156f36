"""Owns the comparison of engines as a command shows it: certified, as a table, as JSON and as a figure."""

from __future__ import annotations

import math
import statistics
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from softclose.config import CampaignConfig, ConfigError
from softclose.propose.side_by_side import EngineRun, compare_engines, with_seed
from softclose_workflows.analyses.certified_tables import waveform_rows_of, wide_console
from softclose_workflows.analyses.certify import assess_fresh, simulate_fresh


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """One engine on one seed, and the truth about its best waveform."""

    run: EngineRun
    """What it found."""
    certified_g_cm_s: float
    """g of its best waveform on fresh switches [cm/s]; NaN where none were asked for."""


def compare(
    config: CampaignConfig, engines: Sequence[str], seeds: Sequence[int], n_switches: int, *, quiet: bool
) -> list[Compared]:
    """Every engine on every seed; n_switches fresh switches certify each best waveform."""
    results = []
    for run in compare_engines(config, engines, seeds):
        g = math.nan
        if n_switches:
            own = with_seed(config, run.seed)
            (response,) = simulate_fresh(own, [run.best.waveform], n_switches=n_switches, seed=run.seed)
            g = assess_fresh(response, own).g_cm_s
        results.append(Compared(run=run, certified_g_cm_s=g))
        if not quiet and sys.stderr.isatty():
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
                "waveform": waveform_rows_of(r.run.best.waveform),
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
        "g, training \\[cm/s]",
        "g, certified \\[cm/s]",
        "time \\[s]",
        "proposal \\[s]",
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


def draw(results: Sequence[Compared], path: str | Path) -> None:
    """Best g against evaluations and against time: median, and the range over the seeds."""
    import matplotlib  # here: it is slow to import
    from matplotlib.figure import Figure

    style: Any = {"svg.hashsalt": "softclose", "font.size": 9, "axes.spines.top": False, "axes.spines.right": False}
    with matplotlib.rc_context(style):
        figure = Figure(figsize=(10, 4), layout="constrained")
        left, right = figure.subplots(1, 2, sharey=True)
        for engine, runs in by_engine(results).items():
            n = min(len(r.run.best_g_cm_s) for r in runs)
            g = np.array([r.run.best_g_cm_s[:n] for r in runs])
            wall = np.median([r.run.wall_s[:n] for r in runs], axis=0)
            for axes, x in ((left, np.arange(1, n + 1)), (right, wall)):
                (line,) = axes.plot(x, np.median(g, axis=0), label=engine)
                axes.fill_between(x, g.min(axis=0), g.max(axis=0), color=line.get_color(), alpha=0.15, lw=0)
        left.set_xlabel("evaluations")
        left.set_ylabel("best g on the training ensemble [cm/s]")
        right.set_xlabel("time [s]")
        right.set_xscale("log")
        left.legend()
        try:
            figure.savefig(path, metadata={"Date": None} if Path(path).suffix == ".svg" else None)
        except (OSError, ValueError) as e:
            raise ConfigError(f"the figure cannot be written to {path}: {e}") from e
