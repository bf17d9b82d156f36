"""Owns who is asked for candidate i: the user's own waveforms, then the engine, then the finishing stage.

A pure function of the configuration and the records: the same on the first run, on resume, and in a replay.
"""

from __future__ import annotations

from collections.abc import Sequence

from threadpoolctl import threadpool_limits

from softclose.propose.protocol import Engine, Observation, Problem, Proposal, load_engine, seen_by
from softclose.waveform import Waveform, WaveformError


class Proposer:
    """Asks the right engine for each candidate. Keeps engines loaded, and no state of theirs."""

    def __init__(self, problem: Problem) -> None:
        # For this process's life: the order of a threaded sum would show in the last bits of a proposal.
        threadpool_limits(limits=1)
        self._problem = problem
        self._initial = problem.config.waveform.initial_waveforms()
        self._engines: dict[str, Engine] = {}

    def propose(self, i: int, history: Sequence[Observation], unseen: Sequence[Waveform]) -> Proposal:
        """Candidate i, from the records 0 … i - lag and the waveforms of the candidates between.

        An engine that fails is replaced by a quasi-random point, and the proposal's note says why.
        """
        config = self._problem.config
        if i < len(self._initial):
            return Proposal(waveform=self._initial[i], origin="initial", n_switches=config.population.n_switches)
        name = config.optimiser.engine if i < config.campaign.budget else "finish"
        try:
            proposal = self._engine(name).propose(self._problem, i, history, unseen)
            proposal.waveform.check(config.waveform.max_volts, config.model.horizon_us)
        except (ArithmeticError, IndexError, RuntimeError, ValueError, WaveformError) as e:
            fallback = self._engine("sobol").propose(self._problem, i, history, unseen)
            return Proposal(
                waveform=fallback.waveform,
                origin=f"fallback: {fallback.origin}",
                n_switches=fallback.n_switches if name != "finish" else config.finish.n_switches,
                note=f"engine {name} failed with {type(e).__name__}: {e}",
            )
        return proposal

    def from_history(self, i: int, history: Sequence[Observation]) -> Proposal:
        """Candidate i as it was proposed, from the records 0 … i - 1; of the newest `lag` - 1 only the waveforms."""
        seen = seen_by(i, history, self._problem.config.campaign.lag)
        return self.propose(i, seen, [o.waveform for o in history[len(seen) : i]])

    def _engine(self, name: str) -> Engine:
        if name not in self._engines:
            self._engines[name] = load_engine(name)
        return self._engines[name]
