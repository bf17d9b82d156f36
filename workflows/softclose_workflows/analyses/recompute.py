"""Owns computing again what a store holds: for `verify --replay`, which compares bits, and for `verify --repair`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.config import CampaignConfig
from softclose.propose.proposer import Proposer
from softclose.propose.protocol import Problem
from softclose_store import Campaign as StoredCampaign
from softclose_store import DriverStore, Recompute, open_campaign
from softclose_workflows.run import records
from softclose_workflows.run.creation import population_columns
from softclose_workflows.run.tasks import chunk_task, compute_chunk, times_us


@dataclass(frozen=True, slots=True, kw_only=True)
class Replay:
    """What was computed again, and what came out otherwise."""

    chunks: tuple[tuple[int, int], ...]
    """(candidate, chunk) of each chunk computed again."""
    proposals: tuple[int, ...]
    """Candidates whose proposal was asked for again."""
    differing: tuple[str, ...]
    """What is not equal bit for bit."""

    @property
    def ok(self) -> bool:
        """True where every bit is the same."""
        return not self.differing


def replay(path: str, k: int, seed: int = 0) -> Replay:
    """Compute k random chunks and k random proposals of committed candidates again, and compare bits.

    Bits may differ on another processor or with other library versions: the store's runtime names its own.
    """
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    stored = campaign.records()
    rng = np.random.default_rng(seed)
    usable = [int(i) for i in np.flatnonzero(~stored["failed"])]
    every = [(i, chunk) for i in usable for chunk in range(-(-int(stored["n_switches"][i]) // config.chunk_switches))]
    chunks = [every[int(j)] for j in sorted(rng.permutation(len(every))[:k])]
    proposals = sorted(int(i) for i in rng.permutation(campaign.committed)[:k])
    switches = campaign.switches()
    differing = [
        problem for i, chunk in chunks for problem in _compare_chunk(campaign, config, stored, switches, i, chunk)
    ]
    proposer = Proposer(Problem(config))
    history = records.observations(stored)
    for i in proposals:
        again = records.proposal_record(proposer.from_history(i, history))
        now, then = np.asarray(again["waveform"]), stored["waveform"][i][: len(again["waveform"])]
        if now.tobytes() != np.ascontiguousarray(then).tobytes():
            differing.append(f"proposal of candidate {i}: {now.tolist()} instead of {then.tolist()}")
    return Replay(chunks=tuple(chunks), proposals=tuple(proposals), differing=tuple(differing))


def _compare_chunk(
    campaign: StoredCampaign,
    config: CampaignConfig,
    stored: Mapping[str, NDArray[Any]],
    switches: NDArray[np.float64],
    i: int,
    chunk: int,
) -> list[str]:
    proposal = {name: stored[name][i] for name in ("waveform", "n_switches")}
    arrays = _chunk_arrays(config, campaign.path, switches, i, chunk, proposal)
    rows = slice(chunk * config.chunk_switches, chunk * config.chunk_switches + len(arrays["closed"]))
    with campaign.dataset() as dataset:
        return [
            f"candidate {i}, chunk {chunk}: {name}"
            for name, now in arrays.items()
            if np.ascontiguousarray(dataset[name][i, rows].to_numpy()).tobytes()
            != np.ascontiguousarray(now, dtype=dataset[name].dtype).tobytes()
        ]


def _chunk_arrays(
    config: CampaignConfig, path: str, switches: NDArray[np.float64], i: int, chunk: int, proposal: Mapping[str, Any]
) -> dict[str, NDArray[Any]]:
    from softclose.waveform import Waveform

    waveform = Waveform.from_rows(proposal["waveform"])
    task = chunk_task(config, path, i, chunk, waveform, int(proposal["n_switches"]), digest=0)
    return compute_chunk(task, switches)


def recompute() -> Recompute:
    """How to compute again whatever a store holds."""
    return Recompute(population=_population, times_us=_times, proposal=_proposal, chunk=_chunk, record=_record)


def _population(config: Mapping[str, Any]) -> dict[str, NDArray[np.float64]]:
    return population_columns(CampaignConfig.from_dict(config))


def _times(config: Mapping[str, Any]) -> NDArray[np.float64]:
    c = CampaignConfig.from_dict(config)
    return times_us(c.model.horizon_us, c.store.n_times)


def _proposal(store: DriverStore, i: int) -> dict[str, Any]:
    config = CampaignConfig.from_dict(store.config)
    history = records.observations({name: values[:i] for name, values in store.records().items()})
    return records.proposal_record(Proposer(Problem(config)).from_history(i, history))


def _chunk(store: DriverStore, i: int, chunk: int) -> dict[str, NDArray[Any]]:
    proposal = store.proposal(i)
    if proposal is None:
        raise LookupError(f"candidate {i} has no intact proposal")
    config = CampaignConfig.from_dict(store.config)
    return _chunk_arrays(config, store.path, store.population, i, chunk, proposal)


def _record(store: DriverStore, i: int) -> dict[str, Any]:
    config = CampaignConfig.from_dict(store.config)
    return records.assessment_record(records.assess_stored(store.read_switch_metrics(i), config))
