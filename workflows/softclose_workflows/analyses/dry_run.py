"""Owns what `run --dry-run` says: waves, trajectories, bytes and minutes, before anything is written."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from softclose.evaluate import draw, respond
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_workflows.analyses.references import UNSHAPED, reference_designs
from softclose_workflows.analyses.starting import explained, n_trajectories
from softclose_workflows.run.executors import Placement
from softclose_workflows.run.needs import of_run

N_TIMED = 400
"""Switches that the rate is measured on."""


def dry_run(config: CampaignConfig, placement: Placement) -> list[str]:
    """A line each. The rate is measured here, on the reference step, so the kernel is compiled where it is not yet."""
    needs = of_run(config, workers=placement.n_processes)
    per_s = rate(config, reference_designs(config).designs[UNSHAPED])
    workers = max(placement.n_processes, 1)
    minutes = n_trajectories(config) / per_s / workers / 60.0
    return [
        *explained(config),
        f"disk: at least {_bytes(needs.disk_bytes)}; memory: at least {_bytes(needs.memory_bytes)}",
        f"rate: {per_s:,.0f} trajectories a second on one core of this machine (measured on the unshaped step)",
        f"time: at least {_minutes(minutes)} of simulation on {workers} worker{'s' * (workers != 1)}",
        "proposing and storing come on top; with a Gaussian process, proposing takes most of the time",
        "nothing was written",
    ]


def rate(config: CampaignConfig, waveform: Waveform) -> float:
    """Trajectories a second of one core, sampled as the campaign stores them."""
    lot = draw(config, N_TIMED, seed=config.campaign.seed)
    sampled: dict[str, Any] = {
        "times_us": np.linspace(0.0, config.model.horizon_us, config.store.n_times),
        "dtype": np.float32,
    }
    respond(config, lot, waveform, **sampled)  # compiles
    started = time.perf_counter()
    respond(config, lot, waveform, **sampled)
    return N_TIMED / max(time.perf_counter() - started, 1e-6)


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
