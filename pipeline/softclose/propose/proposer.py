"""Owns who is asked for a wave: the user's own waveforms, then the engine of its stage.

A pure function of the configuration and the records: the same on the first run, on resume, and in a replay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from threadpoolctl import threadpool_limits

from softclose.propose.by_hand import ByHand
from softclose.propose.extensions import extensions, problem_of
from softclose.propose.origins import FALLBACK, INITIAL
from softclose.propose.plan import SEARCH
from softclose.propose.protocol import (
    Engine,
    EngineError,
    Observation,
    Problem,
    Proposal,
    Wave,
    WaveEngine,
    load_engine,
    seen_by,
)
from softclose.propose.sobol import initial_point
from softclose.waveform import Waveform

_FAILURES = (ArithmeticError, IndexError, LookupError, RuntimeError, ValueError)


class Proposer:
    """Asks the right engine for each wave. Keeps engines loaded, and no state of theirs."""

    def __init__(
        self, problem: Problem, search: Engine | WaveEngine | None = None, by_hand: ByHand | None = None
    ) -> None:
        """search: the search's engine; as a rule the one that the configuration names. by_hand: what a person has
        changed of the campaign."""
        # For this process's life: the order of a threaded sum would show in the last bits of a proposal.
        threadpool_limits(limits=1)
        self._problem = problem
        self._by_hand = by_hand or ByHand()
        self._initial = problem.config.waveform.initial_waveforms()
        self._engines = {} if search is None else {problem.config.optimiser.engine: search}
        self._extensions = {
            stage: (e.engine, problem_of(problem, e)) for stage, e in extensions(problem.config).items()
        }

    def propose(self, wave: Wave, history: Sequence[Observation], pending: Sequence[Waveform]) -> tuple[Proposal, ...]:
        """The candidates of a wave, from the records that it sees and the waveforms of the waves between.

        A candidate whose engine fails is replaced by a quasi-random point, and the proposal's note says why. What was
        chosen by hand takes the place of what is proposed.
        """
        return self._by_hand.placed(wave, self._proposed(wave, self._by_hand.seen(wave, history), pending))

    def _proposed(
        self, wave: Wave, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> tuple[Proposal, ...]:
        given = self._initial[wave.start : wave.stop]
        found = [Proposal(waveform=w, origin=INITIAL, n_switches=wave.n_switches) for w in given]
        if len(found) == wave.size:
            return tuple(found)
        rest = replace(wave, start=wave.start + len(found), size=wave.size - len(found))
        in_flight = [*pending, *given]
        name, problem = self._asked(wave.stage)
        try:
            engine = self._engine(name)
            asked: Sequence[Proposal | Exception]
            if isinstance(engine, WaveEngine):
                asked = engine.propose_wave(problem, rest, history, in_flight)
                if len(asked) != rest.size:
                    raise ValueError(f"{len(asked)} proposals for a wave of {rest.size}")
            else:
                asked = self._one_by_one(engine, problem, rest, history, in_flight)
        except EngineError:
            raise  # it does not fit the search, or is not installed: no candidate of it ever will
        except _FAILURES as e:
            asked = [e] * rest.size
        return (*found, *(self._checked(name, rest, k, proposal) for k, proposal in enumerate(asked)))

    def from_history(self, wave: Wave, history: Sequence[Observation]) -> tuple[Proposal, ...]:
        """The candidates of a wave as they were proposed, from the records of all waves before it."""
        seen = seen_by(wave, history)
        return self.propose(wave, seen, [o.waveform for o in history[len(seen) : wave.start]])

    def _one_by_one(
        self, engine: Engine, problem: Problem, wave: Wave, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> list[Proposal | Exception]:
        """An engine that proposes one candidate at a time has the others of the wave before its eyes."""
        in_flight = list(pending)
        found: list[Proposal | Exception] = []
        for index in range(wave.start, wave.stop):
            try:
                proposal = engine.propose(problem, index, history, in_flight)
            except EngineError:
                raise
            except _FAILURES as e:
                found.append(e)
                continue
            found.append(proposal)
            in_flight.append(proposal.waveform)
        return found

    def _checked(self, name: str, wave: Wave, k: int, proposal: Proposal | Exception) -> Proposal:
        """A proposal that may be simulated, or a quasi-random point that says why it is none."""
        limits = self._problem.config
        try:
            if isinstance(proposal, Exception):
                raise proposal
            proposal.waveform.check(limits.waveform.max_volts, limits.model.horizon_us, limits.waveform.least_rise_us)
            if proposal.n_switches != wave.n_switches:
                raise ValueError(f"{proposal.n_switches} switches for a wave of {wave.n_switches}")
        except _FAILURES as e:
            point = initial_point(self._problem, wave.start + k, "fallback")
            return Proposal(
                waveform=self._problem.space.waveform(point),
                origin=FALLBACK,
                n_switches=wave.n_switches,
                note=f"engine {name} failed with {type(e).__name__}: {e}"[:200],
            )
        return proposal

    def _asked(self, stage: str) -> tuple[str, Problem]:
        """Name of the engine of a stage, and the problem as it sees it."""
        if stage in self._extensions:
            return self._extensions[stage]
        return self._problem.config.optimiser.engine if stage == SEARCH else stage, self._problem

    def _engine(self, name: str) -> Engine | WaveEngine:
        if name not in self._engines:
            self._engines[name] = load_engine(name)
        return self._engines[name]
