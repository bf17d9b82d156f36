"""Owns the unit of distributed work: simulate one block of candidates and switches, and store it.

A pure function of its task and the stored population: running it twice writes bit-identical results.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray
from softclose.device.protocol import is_own_word
from softclose.evaluate.chain import chain_of
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store import CASE_PREFIX, IMPACT_QUANTITIES, RESPONSE_QUANTITIES

if TYPE_CHECKING:
    from softclose.device.simulate import Responses

PLACE = {quantity.name: k for k, quantity in enumerate(RESPONSE_QUANTITIES)}
"""Where a quantity stands in the array `response`."""

Rows = tuple[tuple[float, float, float, float], ...]
"""A waveform as plain numbers: (start, rise, peak, volts) of each pulse; a peak of inf holds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockTask:
    """Everything one worker needs to compute and store one block."""

    store: str
    """Path or URL of the campaign's store."""
    fingerprint: str
    """The campaign that the store has to hold."""
    stage: str
    row: int
    """Which candidates of the stage."""
    column: int
    """Which switches of the stage."""
    first: int
    """Campaign-wide index of the block's first candidate, for messages."""
    start: int
    """First row of the population in this block."""
    stop: int
    """One past the last."""
    waveforms: tuple[Rows, ...]
    proposals_digest: int
    """Ties the block's marker to the waveforms that it was computed for."""

    @property
    def name(self) -> str:
        """`candidates 20 to 39, switches 0 to 255`, for messages."""
        last = self.first + len(self.waveforms) - 1
        return f"candidates {self.first} to {last}, switches {self.start} to {self.stop - 1}"

    @property
    def key(self) -> str:
        """What a scheduler calls it."""
        return f"block-{self.stage}-{self.row}-{self.column}"

    def run(self) -> BlockResult:
        """Compute it and store it."""
        return run_block(self)

    @property
    def place(self) -> tuple[int, int]:
        """Row and column."""
        return self.row, self.column


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockResult:
    """What comes back with a task; everything else went to the store. c candidates, s switches."""

    max_contact_speed: FloatArray
    """(c, s) [µm/µs]."""
    closed: NDArray[np.bool_]
    """(c, s)."""
    status: NDArray[np.int8]
    """(c, s)."""
    settling_us: FloatArray
    """(c, s) [µs]."""
    marker: NDArray[np.uint64]
    """The block's digests, as stored."""
    failures: Mapping[int, str]
    """Candidate of the block -> why the device model could not answer."""
    simulate_s: float
    """Time in the device model [s]."""
    store_s: float
    """Time spent storing [s]: digests, compression, writing."""
    write_s: float = 0.0
    """Of that, waiting for the disk or the service [s]."""
    asked: FloatArray | None = None
    """(c, s, k) further quantities; None where the campaign asks for none."""


def rows_of(waveform: Waveform) -> Rows:
    """A waveform as a task carries it."""
    return tuple((p.start_us, p.rise_us, p.peak_us, p.volts) for p in waveform.pulses)


def times_us(config: CampaignConfig) -> FloatArray:
    """The uniform grid of the stored trajectories: (n_times,) from 0 to the horizon [µs]."""
    return np.linspace(0.0, config.model.horizon_us, config.store.n_times)


def compute_block(
    config: CampaignConfig, lot: Lot, waveforms: tuple[Rows, ...]
) -> tuple[dict[str, NDArray[Any]], dict[int, str]]:
    """Simulate a lot of s switches under each waveform. Returns the arrays of the store's schema, and what failed.

    Where each switch is simulated in several cases, arrays `case_…` hold what it did in each, those without prefix what
    counts: a case is an axis behind the switch. A candidate fails where the device model says so: it would fail
    anywhere. Whatever else is raised is the machine's fault and goes on to the caller.
    """
    from softclose.evaluate import combinations, counted, respond_each
    from softclose.evaluate.asked import asked

    times, n_impacts = times_us(config), config.store.max_impacts
    n_cases = len(combinations(chain_of(config)))
    further: dict[str, Any] = {"further_modes": True} if config.n_modes > 1 else {}
    found: list[dict[str, NDArray[Any]]] = []
    failures: dict[int, str] = {}
    for i, rows in enumerate(waveforms):
        try:
            each = respond_each(
                config,
                lot,
                Waveform.from_rows(rows),
                max_volts=config.waveform.max_volts,
                max_impacts=n_impacts,
                times_us=times,
                dtype=np.float32,
                **further,
            )
        except Exception as e:
            if not is_own_word(e):
                raise
            failures[i] = f"{type(e).__name__}: {e}"
            nothing = _nothing(len(lot), len(asked(config)), n_impacts, len(times), config.n_modes - 1)
            found.append(_with_cases(nothing, [nothing] * n_cases))
            continue
        arrays = [_arrays(r, n_impacts) for r in each]
        found.append(_with_cases(arrays[0] if n_cases == 1 else _arrays(counted(config, each), n_impacts), arrays))
    return {name: _stacked([arrays[name] for arrays in found]) for name in found[0]}, failures


def _arrays(r: Responses, n_impacts: int) -> dict[str, NDArray[Any]]:
    """What is stored of responses of s switches: (s, …) each."""
    known: dict[str, NDArray[Any]] = {
        "max_contact_speed": r.max_contact_speed,
        "first_contact": r.first_contact_us,
        "settling": r.settling_us,
        "n_impacts": r.n_impacts,
        "final_x": r.final_x,
        "final_v": r.final_v,
        "closed": r.closed,
        "status": r.status,
    }
    impact = np.empty((len(r.status), n_impacts, len(IMPACT_QUANTITIES)))
    impact[..., 0], impact[..., 1] = r.impact_time_us, r.impact_speed
    response = np.stack([known[quantity] for quantity in PLACE], axis=-1, dtype=np.float64)
    found = {
        "response": response if r.asked is None else np.concatenate([response, r.asked], axis=-1),
        "x": np.asarray(r.x, dtype=np.float32),
        "v": np.asarray(r.v, dtype=np.float32),
        "impact": impact,
    }
    if r.mode_x is not None:
        found |= {"mode_x": np.asarray(r.mode_x, np.float32), "mode_v": np.asarray(r.mode_v, np.float32)}
    return found


def _with_cases(counts: dict[str, NDArray[Any]], cases: list[dict[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """What counts of a switch, and, where there are several cases, each behind the switch."""
    if len(cases) == 1:
        return counts
    return counts | {f"{CASE_PREFIX}{name}": np.stack([case[name] for case in cases], axis=1) for name in counts}


def _nothing(n: int, n_asked: int, n_impacts: int, n_times: int, n_further: int) -> dict[str, NDArray[Any]]:
    """What is stored of n switches whose device model failed."""
    response = np.full((n, len(PLACE) + n_asked), np.nan)
    response[:, PLACE["closed"]], response[:, PLACE["status"]] = 0.0, -1.0
    x = np.full((n, n_times), np.nan, dtype=np.float32)
    found = {"response": response, "x": x, "v": x, "impact": np.full((n, n_impacts, len(IMPACT_QUANTITIES)), np.nan)}
    if n_further:
        modes = np.full((n, n_further, n_times), np.nan, dtype=np.float32)
        found |= {"mode_x": modes, "mode_v": modes}
    return found


def _stacked(rows: list[NDArray[Any]]) -> NDArray[Any]:
    """Candidates first; a single candidate's array, which may be of many megabytes, is not copied."""
    return rows[0][np.newaxis] if len(rows) == 1 else np.stack(rows)


def run_block(task: BlockTask) -> BlockResult:
    """Compute one block and write it to the store, its marker last."""
    from softclose_store import write_block, writing_s

    config, lot = campaign_of(task.store, task.fingerprint)
    began = time.perf_counter()
    arrays, failures = compute_block(config, lot.rows(slice(task.start, task.stop)), task.waveforms)
    simulated, wrote = time.perf_counter(), writing_s(task.store)
    marker = write_block(task.store, task.stage, task.row, task.column, arrays, task.proposals_digest)
    response = arrays["response"]
    return BlockResult(
        max_contact_speed=np.ascontiguousarray(response[:, :, PLACE["max_contact_speed"]]),
        closed=response[:, :, PLACE["closed"]] == 1.0,
        status=response[:, :, PLACE["status"]].astype(np.int8),
        settling_us=np.ascontiguousarray(response[:, :, PLACE["settling"]]),
        asked=np.ascontiguousarray(response[:, :, len(PLACE) :]) if response.shape[-1] > len(PLACE) else None,
        marker=marker,
        failures=failures,
        simulate_s=simulated - began,
        store_s=time.perf_counter() - simulated,
        write_s=max(writing_s(task.store) - wrote, 0.0),
    )


@lru_cache(maxsize=2)
def campaign_of(store: str, fingerprint: str) -> tuple[CampaignConfig, Lot]:
    """Configuration and ensemble as stored; one read per process and campaign."""
    from softclose_store import StoreError, open_campaign

    campaign = open_campaign(store)
    if campaign.fingerprint != fingerprint:
        raise StoreError(f"{store} holds campaign {campaign.fingerprint[:12]} here, not {fingerprint[:12]}")
    return CampaignConfig.from_dict(campaign.config), Lot(campaign.population())
