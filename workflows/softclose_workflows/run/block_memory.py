"""Owns what a block takes of a worker's memory, and which block would fit."""

from __future__ import annotations

from softclose.settings import CampaignConfig

TRAJECTORY_RAW_BYTES = 60.0
"""V, instants, final state and status of one switch under one waveform, before compression."""

TIME_RAW_BYTES, IMPACT_RAW_BYTES = 8.0, 16.0
"""x and v (float32) of one mode at one instant; time and speed (float64) of one impact."""

BLOCK_FACTOR = 1.3
"""Memory of a block while it is compressed, over its raw size."""

WORKER_SWITCH_BYTES = 64.0
"""Memory of a worker for each switch of the ensemble, while it is read."""


def of_worker(config: CampaignConfig) -> float:
    """Memory that a worker takes for a block, beside its libraries [bytes]."""
    return WORKER_SWITCH_BYTES * config.n_switches_max + _trajectory_bytes(config) * config.block_switches


def _trajectory_bytes(config: CampaignConfig) -> float:
    motion = TIME_RAW_BYTES * config.store.n_times * config.n_modes
    raw = TRAJECTORY_RAW_BYTES + motion + IMPACT_RAW_BYTES * config.store.max_impacts
    return BLOCK_FACTOR * raw * config.n_kept_cases


def too_large_for(config: CampaignConfig, limit_bytes: float) -> str:
    """Why a block does not fit into what a worker may still take, and which would; empty where it fits."""
    needed = of_worker(config)
    if needed <= limit_bytes:
        return ""
    fits = int((limit_bytes - WORKER_SWITCH_BYTES * config.n_switches_max) / _trajectory_bytes(config))
    advice = f"compute.block_switches={fits} fits" if fits > 0 else "no block fits: give workers more memory"
    return (
        f"a block of {config.block_switches:,} trajectories takes {needed / 1e6:,.0f} MB, and a worker has "
        f"{max(limit_bytes, 0.0) / 1e6:,.0f} MB left: {advice}"
    )
