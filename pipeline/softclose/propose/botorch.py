"""Owns the BoTorch engine, an optional extra: noisy expected improvement (qLogNEI) over the whole space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softclose.metrics.ranking import levelled
from softclose.propose.origins import BOTORCH, SOBOL
from softclose.propose.protocol import EngineError, Observation, Problem, Proposal, search_history
from softclose.propose.sobol import initial_point
from softclose.waveform import Waveform


class BotorchEngine:
    """BoTorch's defaults: a fitted single-task GP and qLogNoisyExpectedImprovement, refitted at every proposal."""

    def __init__(self) -> None:
        try:
            import botorch  # noqa: F401
        except ImportError as e:
            raise EngineError(
                "engine 'botorch' needs the packages botorch and torch: pip install botorch, or choose another "
                "optimiser.engine"
            ) from e

    def propose(
        self, problem: Problem, index: int, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> Proposal:
        """Sobol points first, then the maximiser of the acquisition."""
        space = problem.space
        n_switches = problem.config.population.n_switches
        place = index - problem.n_initial_waveforms
        known = [o for o in search_history(problem, history) if o.usable and len(o.waveform.pulses) == space.n_pulses]
        if place < problem.config.optimiser.n_initial or len(known) < 2:
            return Proposal(waveform=space.waveform(initial_point(problem, place)), origin=SOBOL, n_switches=n_switches)
        import torch
        from botorch.acquisition.logei import qLogNoisyExpectedImprovement
        from botorch.fit import fit_gpytorch_mll
        from botorch.models import SingleTaskGP
        from botorch.models.transforms import Standardize
        from botorch.optim import optimize_acqf
        from gpytorch.mlls import ExactMarginalLogLikelihood

        torch.set_num_threads(1)
        with torch.random.fork_rng():
            torch.manual_seed(int(problem.generator("botorch", index).integers(2**62)))
            x = torch.tensor(np.array([space.unit(o.waveform, clip=True) for o in known]))
            y = -torch.tensor(levelled([o.rank_cm_s for o in known])[:, None])
            model = SingleTaskGP(x, y, outcome_transform=Standardize(m=1))
            fit_gpytorch_mll(ExactMarginalLogLikelihood(model.likelihood, model))
            waiting = [space.unit(w, clip=True) for w in pending]
            acquisition = qLogNoisyExpectedImprovement(
                model, X_baseline=x, X_pending=torch.tensor(np.array(waiting)) if waiting else None
            )
            bounds = torch.tensor([[0.0] * space.dim, [1.0] * space.dim], dtype=torch.float64)
            point, _ = optimize_acqf(acquisition, bounds, q=1, num_restarts=8, raw_samples=256)
        return Proposal(waveform=space.waveform(point[0].numpy()), origin=BOTORCH, n_switches=n_switches)
