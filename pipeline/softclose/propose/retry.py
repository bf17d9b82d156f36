"""Owns candidates that are computed again: the waveforms of earlier ones, as candidates of an extension.

What the device model could not answer stays on record, and so does every proposal that saw it fail (ADR 056).
"""

from __future__ import annotations

from collections.abc import Sequence

from softclose.propose.extensions import extensions
from softclose.propose.origins import RETRY
from softclose.propose.protocol import Observation, Problem, Proposal, Wave, even_waves
from softclose.waveform import Waveform


class RetryEngine:
    """The candidates that `campaign.extensions` names, in its order, on the campaign's largest ensemble."""

    def wave_sizes(self, problem: Problem, budget: int) -> list[int]:
        """As many together as in a generation of a descent."""
        return even_waves(budget, problem.config.explore.generation)

    def propose_wave(
        self, problem: Problem, wave: Wave, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> list[Proposal]:
        """The next waveforms, as they stand in the history."""
        extension = extensions(problem.config)[wave.stage]
        begin = wave.start - extension.begin
        return [
            Proposal(
                waveform=history[i].waveform, origin=RETRY, n_switches=wave.n_switches, note=f"candidate {i} again"
            )
            for i in extension.again[begin : begin + wave.size]
        ]
