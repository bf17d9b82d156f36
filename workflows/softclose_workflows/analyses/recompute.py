"""Owns computing again what a store holds: for `verify --replay`, which compares bits, and for `verify --repair`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.evaluate import judge
from softclose.evaluate.asked import told
from softclose.metrics.objective import Judged
from softclose.opening import OpeningError
from softclose.plugins import MEASURED
from softclose.population.lot import Lot
from softclose.propose.plan import plan
from softclose.propose.proposer import Proposer
from softclose.propose.protocol import Problem
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store import BY_HAND, DriverStore, Layout, Recompute, StoreError, open_campaign
from softclose_store import Campaign as StoredCampaign
from softclose_workflows.analyses.certification import CertifyError
from softclose_workflows.analyses.certify import certify_again
from softclose_workflows.analyses.kept_certificates import keep_again
from softclose_workflows.run import actuations, records, releases
from softclose_workflows.run.controlled import GAIN, controlling_of, first_wave
from softclose_workflows.run.creation import population_columns
from softclose_workflows.run.flight import controlled_record, joined_asked
from softclose_workflows.run.opening import candidate_of, designed_opening, keep_releases
from softclose_workflows.run.prior import GROUP, PriorOfStore, basins_again
from softclose_workflows.run.tasks import compute_block, rows_of, times_us
from softclose_workflows.run.trajectories import GROUP as TRAJECTORIES


@dataclass(frozen=True, slots=True, kw_only=True)
class Replay:
    """What was computed again, and what came out otherwise."""

    blocks: tuple[tuple[str, int, int], ...]
    """(stage, row, column) of each block computed again."""
    waves: tuple[int, ...]
    """Waves that were proposed again."""
    differing: tuple[str, ...]
    """What is not equal bit for bit."""

    @property
    def ok(self) -> bool:
        """True where every bit is the same."""
        return not self.differing


def replay(path: str, k: int, seed: int = 0) -> Replay:
    """Compute k random blocks and propose k random waves again, of those committed, and compare bits.

    Bits may differ on another processor or with other library versions: the store's runtime names its own.
    """
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    problem = Problem(config, help=PriorOfStore(path, config))
    waves = plan(problem)[: campaign.n_waves]
    stored = campaign.records()
    rng = np.random.default_rng(seed)
    every = [
        (wave.stage, *place)
        for wave in waves
        for place in campaign.layout.wave_blocks(wave.start, wave.size, wave.n_switches)
    ]
    if config.model.name == MEASURED:  # nobody but the devices can say it again
        every = []
    blocks = [every[int(j)] for j in sorted(rng.permutation(len(every))[:k])]
    chosen = sorted(int(w) for w in rng.permutation(len(waves))[:k])
    switches = Lot(campaign.population())
    differing = [problem for block in blocks for problem in _compare_block(campaign, config, stored, switches, *block)]
    proposer = Proposer(problem, by_hand=records.by_hand(campaign.by_hand, campaign.layout))
    history = records.observations(campaign.records_as_told())
    for w in chosen:
        wave = waves[w]
        for i, proposal in enumerate(proposer.from_history(wave, history), start=wave.start):
            now, then = proposal.waveform.rows(), _rows_of(stored["waveform"][i])
            if now.tobytes() != then.tobytes():
                differing.append(f"proposal of candidate {i}: {now.tolist()} instead of {then.tolist()}")
    return Replay(blocks=tuple(blocks), waves=tuple(chosen), differing=tuple(differing))


def _compare_block(
    campaign: StoredCampaign,
    config: CampaignConfig,
    stored: Mapping[str, NDArray[Any]],
    switches: Lot,
    stage: str,
    row: int,
    column: int,
) -> list[str]:
    arrays = _block_arrays(config, campaign.layout, switches, stored, stage, row, column)
    own = campaign.layout.stage(stage)
    n_switches = arrays["response"].shape[1]
    candidates, begin = own.candidates(row), own.switches(column).start
    with campaign.dataset(stage) as dataset:
        return [
            f"stage {stage}, block {row}, {column}: {name}"
            for name, now in arrays.items()
            if np.ascontiguousarray(dataset[name][candidates, begin : begin + n_switches].to_numpy()).tobytes()
            != np.ascontiguousarray(now, dtype=dataset[name].dtype).tobytes()
        ]


def _block_arrays(
    config: CampaignConfig,
    layout: Layout,
    switches: Lot,
    stored: Mapping[str, NDArray[Any]],
    stage: str,
    row: int,
    column: int,
) -> dict[str, NDArray[Any]]:
    """One block from the recorded waveforms of its candidates."""
    own, first = layout.stage(stage), layout.first(stage)
    candidates, rows = own.candidates(row), own.switches(column)
    indices = range(first + candidates.start, first + candidates.stop)
    waveforms = tuple(rows_of(Waveform.from_rows(stored["waveform"][i])) for i in indices)
    stop = min(rows.stop, int(stored["n_switches"][indices[0]]))
    return compute_block(config, switches.rows(slice(rows.start, stop)), waveforms)[0]


def _rows_of(waveform: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.ascontiguousarray(waveform[~np.isnan(waveform).all(axis=1)])


def recompute() -> Recompute:
    """How to compute again whatever a store holds."""
    return Recompute(
        population=_population,
        times_us=_times,
        waves=_waves,
        proposals=_proposals,
        block=_block,
        record=_record,
        group=_group,
    )


def _population(config: Mapping[str, Any]) -> dict[str, NDArray[np.float64]]:
    return population_columns(CampaignConfig.from_dict(config))


def _times(config: Mapping[str, Any]) -> NDArray[np.float64]:
    return times_us(CampaignConfig.from_dict(config))


def _waves(config: Mapping[str, Any]) -> list[int]:
    return [wave.size for wave in plan(Problem(CampaignConfig.from_dict(config)))]


def _proposals(store: DriverStore, start: int, size: int) -> Sequence[Mapping[str, Any]]:
    """The wave that begins at `start`."""
    config = CampaignConfig.from_dict(store.config)
    problem = Problem(config, help=PriorOfStore(store.path, config))
    wave = next(w for w in plan(problem) if w.start == start)
    history = records.observations({name: values[:start] for name, values in store.records().items()})
    proposer = Proposer(problem, by_hand=records.by_hand(store.by_hand(), store.layout))
    return [records.proposal_record(p) for p in proposer.from_history(wave, history)]


def _block(store: DriverStore, stage: str, row: int, column: int) -> dict[str, NDArray[Any]]:
    config = CampaignConfig.from_dict(store.config)
    if config.model.name == MEASURED:
        raise StoreError(
            f"block ({row}, {column}) of stage {stage} in {store.path} was measured: nothing computes it again; "
            "restore it from a copy"
        )
    return _block_arrays(config, store.layout, Lot(store.population), store.records(), stage, row, column)


def _record(store: DriverStore, i: int) -> dict[str, Any]:
    """The result of one candidate, from the blocks that hold it."""
    config = CampaignConfig.from_dict(store.config)
    response = _response(store, i)
    controlling = controlling_of(config, Lot(store.population), {GAIN: np.empty(0)})
    if controlling is None:
        found = judge(config, response)
        return records.assessment_record(found, told(config, response, found))
    waveforms = store.records()["waveform"]
    first = [(Waveform.from_rows(waveforms[k]), _response(store, k)) for k in range(first_wave(config))]
    controlling.decide([(waveform, r) for waveform, r in first if (r.status >= 0).all()])
    return controlled_record(controlling, Waveform.from_rows(waveforms[i]), response, is_first=i < len(first))


def _response(store: DriverStore, i: int) -> Judged:
    """What the switches of a candidate did, from the blocks that hold it."""
    stage, local = store.layout.stage_of(i)
    n_switches = int(store.records()["n_switches"][i])
    row = local // stage.block_candidates
    parts = [store.read_assessed(stage.name, row, column, n_switches) for column in range(stage.blocks_of(n_switches))]
    at = local - stage.candidates(row).start
    return Judged(
        max_contact_speed=np.concatenate([part["max_contact_speed"][at] for part in parts]),
        closed=np.concatenate([part["closed"][at] for part in parts]).astype(np.bool_),
        status=np.concatenate([part["status"][at] for part in parts]),
        settling_us=np.concatenate([part["settling"][at] for part in parts]),
        asked=joined_asked([part["asked"][at] for part in parts if "asked" in part]),
    )


def _group(path: str, name: str, attributes: Mapping[str, Any] | None) -> str:
    """A certification again, whose attributes say what it was asked for; the opening of a candidate; the basins."""
    if name.startswith(f"{BY_HAND}/"):
        return f"{name} of {path} says what was changed by hand, which nothing computes again: restore it from a copy"
    try:
        if name == GROUP:
            return basins_again(path)
        if name == actuations.NAME:
            return actuations.actuated_again(path)
        if name.startswith(f"{TRAJECTORIES}/certification-"):
            return keep_again(path, name)
        released = releases.candidate_of(name)
        if released is not None:
            return keep_releases(path, released)
        candidate = candidate_of(name)
        if candidate is None:
            certify_again(path, name, attributes)
        elif designed_opening(path, candidate) is None:
            return f"{name} of {path} belongs to no opening that this campaign designs: delete that group"
    except (CertifyError, OpeningError, StoreError) as e:
        return str(e)
    return ""
