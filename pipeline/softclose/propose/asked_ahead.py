"""Owns asking for the waves of descents on a prior where others evaluate: whole stretches of a descent, or its next
generation while those of others are evaluated.

What is proposed is not taken from what was asked ahead: it is what it would be without, and an answer is found by the
very waveforms that it belongs to.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Any

from softclose.propose import explore, finish
from softclose.propose.following import Following, Sharing, as_told
from softclose.propose.promises import PriorValues
from softclose.propose.protocol import Observation, Problem, Proposal, Wave
from softclose.propose.stretches import WORTH, Asking, Stretch, key_of, length
from softclose.waveform import Waveform

Records = Callable[[int, Sequence[Proposal], PriorValues], list[Observation]]
"""What is told of the proposals from a place of the wave on."""


class AskedAhead:
    """The waves of descents on a prior, one after the other."""

    def __init__(self, problem: Problem, asking: Asking) -> None:
        self._problem, self._asking = problem, asking
        self._begun: dict[bytes, Any] = {}
        """Questions for one generation, by its waveforms."""
        self._answered: dict[bytes, PriorValues] = {}
        """What stretches have brought of generations to come, by their waveforms."""
        self._stretches: dict[Hashable, tuple[Stretch, Any]] = {}
        """Those under way, by descent."""
        self._alone: set[Hashable] = set()
        """Descents that a stretch could not follow to its end."""

    def wave(
        self, wave: Wave, proposals: Sequence[Proposal], history: Sequence[Observation], records: Records
    ) -> tuple[list[Observation], str]:
        """The records of a wave, and why waveforms have no value."""
        following = explore.following(self._problem, wave, history) or finish.following(self._problem, wave, history)
        shares = _Shares(wave, [p.waveform for p in proposals], following)
        for number in range(len(shares.waveforms)):
            self._send(shares, number)
        told: list[Observation] = []
        failure, each = "", shares.each
        for number in range(len(shares.waveforms)):
            found = self._answer(shares, number)
            self._look_ahead(shares, number, found)
            told += records(number * each, proposals[number * each : (number + 1) * each], found)
            failure = failure or found.failure
        return told, failure

    def _send(self, shares: _Shares, number: int) -> None:
        """Ask for what nobody has been asked for yet."""
        key, descent = key_of(shares.waveforms[number]), shares.descent(number)
        if key in self._begun or key in self._answered:
            return
        if descent is None or (who := descent.beginning.key) in self._alone or not self._is_followed(shares):
            self._begin(shares, shares.waveforms[number])
        elif who not in self._stretches:
            self._follow(descent, shares, shares.n_left + 1)

    def _is_followed(self, shares: _Shares) -> bool:
        """Whether a generation is too little work to be dealt out, and more follow."""
        return shares.n_left > 0 and self._asking.n_elsewhere > 1 and shares.trajectories < WORTH

    def _follow(self, descent: Sharing, shares: _Shares, left: int) -> None:
        is_dealt = len(shares.waveforms) > self._asking.n_elsewhere
        n = length(shares.trajectories, left, is_dealt=is_dealt)
        stretch = Stretch(descent=descent, n_generations=n, n_switches=shares.n_switches)
        self._stretches[descent.beginning.key] = stretch, self._asking.begin_stretch(stretch)

    def _begin(self, shares: _Shares, waveforms: Sequence[Waveform]) -> None:
        beside = len(shares.waveforms)
        self._begun[key_of(waveforms)] = self._asking.begin(waveforms, shares.n_switches, beside=beside)

    def _answer(self, shares: _Shares, number: int) -> PriorValues:
        """What the prior says of a share."""
        key, descent = key_of(shares.waveforms[number]), shares.descent(number)
        if key not in self._answered and descent is not None and descent.beginning.key in self._stretches:
            self._receive(shares, descent.beginning.key, key)
        if key in self._answered:
            return self._answered.pop(key)
        if key not in self._begun:
            self._begin(shares, shares.waveforms[number])
        return self._asking.wait(self._begun.pop(key))

    def _receive(self, shares: _Shares, who: Hashable, key: bytes) -> None:
        """Wait for a stretch, and have the next one of its descent run."""
        stretch, question = self._stretches.pop(who)
        run = self._asking.wait_stretch(question)
        self._answered.update((generation.key, generation.values) for generation in run)
        left = shares.n_left + 1 - len(run)
        if len(run) < stretch.n_generations or key not in self._answered:
            self._alone.add(who)
        elif left > 0:
            told = (as_told(generation.values.g_cm_s) for generation in run)
            self._follow(stretch.descent.after(*told), shares, left)

    def _look_ahead(self, shares: _Shares, number: int, found: PriorValues) -> None:
        """Ask for the next generation of a descent that no stretch follows."""
        descent = shares.descent(number)
        if descent is None or not shares.n_left or descent.beginning.key in self._stretches:
            return
        try:
            points = descent.after(as_told(found.g_cm_s)).points(self._problem)
            waveforms = self._problem.space.waveforms(points)
        except Exception:  # the wave itself meets it again, and says what is proposed instead
            self._problem.descents.clear()
            return
        if key_of(waveforms) not in self._answered:
            self._begin(shares, waveforms)


class _Shares:
    """The waveforms of a wave, by who asks for them."""

    def __init__(self, wave: Wave, waveforms: Sequence[Waveform], following: Following | None) -> None:
        self._sharing = () if following is None else following.sharing
        self.n_left = 0 if following is None else following.n_left
        self.n_switches = wave.n_switches
        self.each = wave.size // max(len(self._sharing), 1)
        self.waveforms = [waveforms[i : i + self.each] for i in range(0, wave.size, self.each)]

    @property
    def trajectories(self) -> int:
        """Of one share."""
        return self.each * self.n_switches

    def descent(self, number: int) -> Sharing | None:
        """Whose a share is; None of what no descent asks for."""
        return self._sharing[number] if self._sharing else None
