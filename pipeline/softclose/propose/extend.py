"""Owns what an extension proposes where the campaign did not end with its search: a descent from the best it knows.

Each extension is a stage of its own. Nothing that came before it is proposed again, so its length may be chosen when
the campaign is finished (ADR 056).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softclose.arrays import FloatArray
from softclose.propose.basins import distinct_basins
from softclose.propose.descents import Beginning, continued
from softclose.propose.explore import stage_g
from softclose.propose.extensions import extensions
from softclose.propose.origins import EXTENDED
from softclose.propose.protocol import Observation, Problem, Proposal, Wave, even_waves
from softclose.waveform import Waveform


class ExtendEngine:
    """Generations of one CMA-ES descent, as wide as polishing is at its start, on the campaign's largest ensemble."""

    def wave_sizes(self, problem: Problem, budget: int) -> list[int]:
        """Whole generations, and what is left."""
        return even_waves(budget, problem.config.explore.generation)

    def propose_wave(
        self, problem: Problem, wave: Wave, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> list[Proposal]:
        """The next generation, from the records of the extension so far."""
        settings, each = problem.config.finish, problem.config.explore.generation
        begin = extensions(problem.config)[wave.stage].begin
        start = _start(problem, history[:begin])
        g = stage_g(problem, history, begin, wave.start)
        run = continued(
            problem,
            Beginning(stream="extend", who=begin, start=start, sigma=settings.sigma, generation=each),
            [g[i : i + each] for i in range(0, len(g), each)],
        )
        waveforms = problem.space.waveforms(run.points()[: wave.size])
        return [Proposal(waveform=w, origin=EXTENDED, n_switches=wave.n_switches) for w in waveforms]


def _start(problem: Problem, history: Sequence[Observation]) -> FloatArray:
    """(d,) the best candidate on the largest ensemble so far; the middle of the cube where there is none."""
    most = max((o.n_switches for o in history if o.usable), default=0)
    judged = [o for o in history if o.n_switches == most]
    best = distinct_basins(problem, judged, 1, problem.config.finish.distance)
    return problem.space.unit(best[0].waveform, clip=True) if best else np.full(problem.space.dim, 0.5)
