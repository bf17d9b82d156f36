"""Owns one wave between its proposal and its commit: what was asked, what has come back, and what that is worth."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.device.status import reasons
from softclose.evaluate import judge
from softclose.evaluate.asked import told
from softclose.evaluate.quantities import Value
from softclose.metrics.objective import MAX_FAILED, MISSING, Assessment, Judged
from softclose.propose.protocol import Proposal, Wave
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store import Layout, assessed_digest, proposals_digest
from softclose_workflows.run import records
from softclose_workflows.run.controlled import GAIN, Controlling
from softclose_workflows.run.tasks import BlockResult, BlockTask, rows_of

Place = tuple[int, int]
"""Row and column of a block in its stage."""

Share = tuple[BlockResult, int]
"""A result, and the place of a candidate in it."""


@dataclass(slots=True)
class Flight:
    """The blocks of one wave and their results so far."""

    wave: Wave
    proposals: Sequence[Proposal]
    tasks: dict[Place, BlockTask]
    results: dict[Place, BlockResult] = field(default_factory=dict)
    propose_s: float = 0.0
    """Time that the wave's proposals took [s]."""
    started: float = field(default_factory=time.monotonic)

    @property
    def missing(self) -> list[BlockTask]:
        """Blocks without a result."""
        return [task for place, task in self.tasks.items() if place not in self.results]

    @property
    def markers(self) -> dict[Place, NDArray[np.uint64]]:
        """The digests of every block, as stored."""
        return {place: result.marker for place, result in self.results.items()}

    def receive(self, task: BlockTask, result: BlockResult) -> None:
        """Keep a result. Raises ValueError where it is not what the worker's own digest says."""
        found = assessed_digest(
            task.stage,
            *task.place,
            task.proposals_digest,
            result.max_contact_speed,
            result.closed,
            result.status,
            result.settling_us,
            result.asked,
        )
        if found != int(result.marker[-1]):
            raise ValueError(f"the result of {task.name} is not what its worker stored: it was damaged on its way")
        self.results[task.place] = result

    def rows(self, config: CampaignConfig, controlling: Controlling | None = None) -> list[dict[str, Any]]:
        """The wave's records, in the order of its candidates.

        controlling: who judges them by the prior too, where the campaign has it so. Raises PriorError.
        """
        parts = [self._parts(i) for i in range(len(self.proposals))]
        responses = [None if self._failures(own) else self._response(own) for own in parts]
        if controlling is not None and controlling.is_used is None:
            told_ = zip(self.proposals, responses, strict=True)
            controlling.decide([(p.waveform, response) for p, response in told_ if response is not None])
        rows = []
        for proposal, own, response in zip(self.proposals, parts, responses, strict=True):
            timings = {
                "wall_propose_s": self.propose_s / self.wave.size,
                "wall_simulate_s": sum(result.simulate_s / len(result.status) for result, _ in own),
            }
            if response is None:
                found = records.failed_record(self._failures(own)[0])
            elif controlling is None:
                found = judged_record(config, response)
            else:
                found = controlled_record(controlling, proposal.waveform, response, is_first=self.wave.index == 0)
            rows.append(records.proposal_record(proposal) | found | timings)
        return rows

    def _parts(self, i: int) -> list[Share]:
        """The results that hold a candidate of the wave, and its place in each."""
        return [
            (result, local)
            for place in sorted(self.results)
            for result, task in [(self.results[place], self.tasks[place])]
            if 0 <= (local := self.wave.start + i - task.first) < len(task.waveforms)
        ]

    @staticmethod
    def _failures(parts: Sequence[Share]) -> list[str]:
        return [result.failures[local] for result, local in parts if local in result.failures]

    @staticmethod
    def _response(parts: Sequence[Share]) -> Judged:
        return Judged(
            max_contact_speed=np.concatenate([result.max_contact_speed[local] for result, local in parts]),
            closed=np.concatenate([result.closed[local] for result, local in parts]),
            status=np.concatenate([result.status[local] for result, local in parts]),
            settling_us=np.concatenate([result.settling_us[local] for result, local in parts]),
            asked=joined_asked([result.asked[local] for result, local in parts if result.asked is not None]),
        )


def controlled_record(
    controlling: Controlling, waveform: Waveform, response: Judged, *, is_first: bool
) -> dict[str, Any]:
    """The same with what the prior adds; is_first: in the first wave, by which it is seen whether it pays."""
    found, gained = controlling.judged(waveform, response, is_first=is_first)
    return judged_record(controlling.campaign, response, found) | {GAIN: gained}


def judged_record(config: CampaignConfig, response: Judged, found: Assessment | None = None) -> dict[str, Any]:
    """The record of what a candidate's switches did; found: its assessment, where it is not that of these alone."""
    found = judge(config, response) if found is None else found
    values = told(config, response, found)
    record = records.assessment_record(found, values)
    if math.isnan(found.g_cm_s):
        record |= {"failed": True, "failure": why_undefined(response, values)}
    return record


def joined_asked(parts: Sequence[NDArray[np.float64]]) -> NDArray[np.float64] | None:
    """Further quantities of a candidate from its blocks; None where there are none."""
    return np.concatenate(parts) if parts else None


def why_undefined(response: Judged, values: Mapping[str, Value]) -> str:
    """Why g is not defined."""
    undefined = [name for name, value in values.items() if math.isnan(value.estimate)]
    if undefined and (response.status == 0).mean() > 1.0 - MAX_FAILED:
        return f"{', '.join(undefined)} is undefined on these switches, and g weighs or limits it"
    return f"{reasons(response.status[response.status != MISSING])}; above {100.0 * MAX_FAILED:g} % g is not defined"


def plan_tasks(
    wave: Wave, proposals: Sequence[Proposal], layout: Layout, *, store: str, fingerprint: str
) -> dict[Place, BlockTask]:
    """The blocks of a wave, by place."""
    stage, first_local = layout.stage_of(wave.start)
    waveforms = [rows_of(proposal.waveform) for proposal in proposals]
    tasks = {}
    digests: dict[int, int] = {}
    for row, column in layout.wave_blocks(wave.start, wave.size, wave.n_switches):
        candidates, switches = stage.candidates(row), stage.switches(column)
        begin = candidates.start - first_local
        own = tuple(waveforms[begin : candidates.stop - first_local])
        first = wave.start + begin
        if row not in digests:
            digests[row] = proposals_digest([np.array(rows) for rows in own], wave.n_switches, first)
        tasks[row, column] = BlockTask(
            store=store,
            fingerprint=fingerprint,
            stage=wave.stage,
            row=row,
            column=column,
            first=first,
            start=switches.start,
            stop=min(switches.stop, wave.n_switches),
            waveforms=own,
            proposals_digest=digests[row],
        )
    return tasks


def recovered(stored: Mapping[str, NDArray[Any]], marker: NDArray[np.uint64]) -> BlockResult | None:
    """The result of a block that an earlier run stored; None where a candidate failed, whose reason is not stored."""
    status = stored["status"].astype(np.int8)
    if (status < 0).any():
        return None
    return BlockResult(
        max_contact_speed=stored["max_contact_speed"],
        closed=stored["closed"].astype(np.bool_),
        status=status,
        settling_us=stored["settling"],
        marker=marker,
        asked=stored.get("asked"),
        failures={},
        simulate_s=0.0,
        store_s=0.0,
    )
