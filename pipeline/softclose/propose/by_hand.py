"""Owns what a person has changed of a campaign: readings that were corrected or withdrawn, waveforms chosen by hand.

A wave sees a corrected reading from the wave on that was the next to be proposed when it was corrected: those before
it were proposed from what was known then, so the campaign stays a pure function of what is on record.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from softclose.propose.origins import BY_HAND
from softclose.propose.protocol import Observation, Proposal, Wave
from softclose.waveform import Waveform


@dataclass(frozen=True, slots=True, kw_only=True)
class Corrected:
    """What counts of a candidate in place of its own record, from a wave on."""

    from_wave: int
    """Index of the first wave whose proposals see it."""
    result: Observation
    """Its result; the proposal in it is not looked at."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ByHand:
    """All that was changed by hand, in the order in which it was."""

    readings: Sequence[Corrected] = ()
    """Of one candidate, the last counts."""
    chosen: Mapping[int, Waveform] = field(default_factory=dict)
    """Waveforms by the candidate in whose place they were applied."""

    def seen(self, wave: Wave, history: Sequence[Observation]) -> Sequence[Observation]:
        """The records as the proposals of a wave see them."""
        latest = {c.result.index: c.result for c in self.readings if c.from_wave <= wave.index}
        if not latest:
            return history
        return [_joined(o, latest[o.index]) if o.index in latest else o for o in history]

    def placed(self, wave: Wave, proposals: Sequence[Proposal]) -> tuple[Proposal, ...]:
        """The proposals of a wave, with the waveforms that were applied in the place of some of them."""
        return tuple(
            Proposal(waveform=self.chosen[i], origin=BY_HAND, n_switches=wave.n_switches) if i in self.chosen else p
            for i, p in enumerate(proposals, start=wave.start)
        )


def _joined(proposed: Observation, result: Observation) -> Observation:
    return replace(
        result,
        wave=proposed.wave,
        waveform=proposed.waveform,
        origin=proposed.origin,
        n_switches=proposed.n_switches,
        beliefs=proposed.beliefs,
    )
