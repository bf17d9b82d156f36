"""Owns what `run --dry-run` says: waves, trajectories, bytes and minutes, before anything is written."""

from __future__ import annotations

from softclose.settings import CampaignConfig
from softclose_workflows.analyses.forecast import prior_switch_s, prior_trajectories, switch_s
from softclose_workflows.analyses.references import UNSHAPED, reference_designs
from softclose_workflows.analyses.starting import explained, n_trajectories
from softclose_workflows.run.executors import Placement
from softclose_workflows.run.needs import of_run


def dry_run(config: CampaignConfig, placement: Placement) -> list[str]:
    """A line each. The rate is measured here, on the reference step, so the kernel is compiled where it is not yet."""
    needs = of_run(config, workers=placement.n_processes)
    step = reference_designs(config).designs[UNSHAPED]
    each, of_prior, n_prior = switch_s(config, step), prior_switch_s(config, step), prior_trajectories(config)
    workers = max(placement.n_processes, 1)
    minutes = (n_trajectories(config) * each + n_prior * of_prior) / workers / 60.0
    uses = [
        "before the first candidate",
        "for the proposals",
        *(["as control variate"] if config.prior.control else []),
    ]
    what_for = f"{', '.join(uses[:-1])} and {uses[-1]}"
    prior = f"prior: {n_prior:,} trajectories of {config.prior.model}, {what_for}" if n_prior else ""
    return [
        *explained(config),
        *filter(None, [prior]),
        f"disk: at least {_bytes(needs.disk_bytes)}; memory: at least {_bytes(needs.memory_bytes)}",
        f"rate: {_per_s(each)} trajectories a second on one core of this machine (measured on the unshaped step)"
        + (f", {_per_s(of_prior)} of the prior" if n_prior else ""),
        f"time: at least {_minutes(minutes)} of simulation on {workers} worker{'s' * (workers != 1)}",
        "proposing and storing come on top",
        "nothing was written",
    ]


def _per_s(each: float) -> str:
    return f"{1.0 / max(each, 1e-9):,.0f}" if each < 0.1 else f"{1.0 / each:.2g}"


def _minutes(minutes: float) -> str:
    if minutes < 2.0:
        return f"{60.0 * minutes:.0f} s"
    return f"{minutes:.0f} min" if minutes < 120.0 else f"{minutes / 60.0:.1f} h"


def _bytes(n: float) -> str:
    for unit in ("B", "kB", "MB", "GB"):
        if n < 1000.0:
            return f"{n:.3g} {unit}"
        n /= 1000.0
    return f"{n:.3g} TB"
