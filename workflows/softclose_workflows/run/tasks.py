"""Owns the unit of distributed work: simulate one chunk of switches under one waveform and store it.

A pure function of its task and the stored population: running it twice writes the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from softclose.config import CampaignConfig
from softclose.waveform import FloatArray, Waveform


@dataclass(frozen=True, slots=True, kw_only=True)
class ChunkTask:
    """Everything one worker needs to compute and store one chunk."""

    store: str
    """Path or URL of the campaign's store."""
    candidate: int
    chunk: int
    start: int
    """First row of the population in this chunk."""
    stop: int
    """One past the last row."""
    waveform: tuple[tuple[float, float, float, float], ...]
    """Rows (start, rise, peak, volts); a peak of inf holds."""
    proposal_digest: int
    """Ties the chunk's marker to the waveform it was computed for."""
    config: CampaignConfig
    """What is applied, and what is kept."""

    @property
    def name(self) -> str:
        """`candidate 12, chunk 3`, for messages."""
        return f"candidate {self.candidate}, chunk {self.chunk}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ChunkResult:
    """What a worker reports; the data itself went to the store."""

    candidate: int
    chunk: int
    n_switches: int


def times_us(horizon_us: float, n_times: int) -> FloatArray:
    """The uniform grid of the stored trajectories: (n_times,) from 0 to the horizon [µs]."""
    return np.linspace(0.0, horizon_us, n_times)


def chunk_task(
    config: CampaignConfig, store: str, candidate: int, chunk: int, waveform: Waveform, n_switches: int, digest: int
) -> ChunkTask:
    """The task of one chunk of one candidate."""
    start = chunk * config.chunk_switches
    rows = tuple((p.start_us, p.rise_us, p.peak_us, p.volts) for p in waveform.pulses)
    return ChunkTask(
        store=store,
        candidate=candidate,
        chunk=chunk,
        start=start,
        stop=min(start + config.chunk_switches, n_switches),
        waveform=rows,
        proposal_digest=digest,
        config=config,
    )


def compute_chunk(task: ChunkTask, switches: FloatArray) -> dict[str, np.ndarray[Any, Any]]:
    """Simulate rows start:stop of switches (n, 4). Returns the arrays of the store's schema, by name."""
    from softclose.evaluate import respond

    config = task.config
    response = respond(
        config,
        switches[task.start : task.stop],
        Waveform.from_rows(task.waveform),
        max_volts=config.waveform.max_volts,
        max_impacts=config.store.max_impacts,
        times_us=times_us(config.model.horizon_us, config.store.n_times),
        dtype=np.float32,
    )
    arrays: dict[str, np.ndarray[Any, Any] | None] = {
        "max_contact_speed": response.max_contact_speed,
        "first_contact": response.first_contact_us,
        "settling": response.settling_us,
        "n_impacts": response.n_impacts,
        "final_x": response.final_x,
        "final_v": response.final_v,
        "closed": response.closed,
        "status": response.status,
        "impact_time": response.impact_time_us,
        "impact_speed": response.impact_speed,
        "x": response.x,
        "v": response.v,
    }
    return {name: array for name, array in arrays.items() if array is not None}


def run_chunk(task: ChunkTask) -> ChunkResult:
    """Compute one chunk and write it to the store, its marker last."""
    from softclose_store import write_chunk

    arrays = compute_chunk(task, _population(task.store))
    write_chunk(task.store, task.candidate, task.chunk, arrays, task.proposal_digest)
    return ChunkResult(candidate=task.candidate, chunk=task.chunk, n_switches=task.stop - task.start)


@lru_cache(maxsize=2)
def _population(store: str) -> FloatArray:
    """(n_switches_max, 4) D, G, K, M as stored; one read per process and store."""
    from softclose_store import read_switches

    switches: FloatArray = read_switches(store)
    return switches
