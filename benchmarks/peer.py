"""One peer, in an environment of its own: points of the unit cube out, values in, a line of JSON each. Knows nothing of
Softclose, and needs nothing but the package that it asks.

    python peer.py optuna-tpe DIMENSIONS SEED BUDGET
"""

from __future__ import annotations

import json
import random
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def uniform(dim: int, seed: int, budget: int) -> Any:
    """No search: what the coordinates alone are worth."""
    draws = random.Random(seed)
    for _ in range(budget):
        yield [draws.random() for _ in range(dim)]


def optuna_with(sampler: Callable[[Any, int], Any]) -> Callable[[int, int, int], Any]:
    def search(dim: int, seed: int, budget: int) -> Any:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.ERROR)
        study = optuna.create_study(sampler=sampler(optuna, seed))
        for _ in range(budget):
            trial = study.ask()
            value = yield [trial.suggest_float(f"x{i}", 0.0, 1.0) for i in range(dim)]
            study.tell(trial, value)

    return search


def cma_es(dim: int, seed: int, budget: int) -> Any:
    import cma

    asked = 0
    while asked < budget:
        options = {"bounds": [0.0, 1.0], "seed": seed + 1 + asked, "verbose": -9}
        strategy = cma.CMAEvolutionStrategy(dim * [0.5], 0.25, options)
        while not strategy.stop() and asked < budget:
            points = strategy.ask()
            values = []
            for point in points:
                values.append((yield [float(v) for v in point]))
                asked += 1
            strategy.tell(points, values)


def plain_skopt(dim: int, seed: int, budget: int) -> Any:
    import skopt

    optimiser = skopt.Optimizer([(0.0, 1.0)] * dim, "GP", n_initial_points=20, random_state=seed)
    for _ in range(budget):
        point = optimiser.ask()
        optimiser.tell(point, (yield [float(v) for v in point]))


def nevergrad_ngopt(dim: int, seed: int, budget: int) -> Any:
    import nevergrad
    import numpy

    space = nevergrad.p.Array(shape=(dim,), lower=0.0, upper=1.0)
    space.random_state = numpy.random.RandomState(seed)
    optimiser = nevergrad.optimizers.NGOpt(space, budget=budget)
    for _ in range(budget):
        candidate = optimiser.ask()
        optimiser.tell(candidate, (yield [float(v) for v in candidate.value]))


def smac_with(facade: str) -> Callable[[int, int, int], Any]:
    """A facade of SMAC3 with its own settings: initial design, model and acquisition."""

    def search(dim: int, seed: int, budget: int) -> Any:
        import ConfigSpace
        import smac
        from smac.runhistory.dataclasses import TrialValue

        space = ConfigSpace.ConfigurationSpace({f"x{i}": (0.0, 1.0) for i in range(dim)}, seed=seed)

        def never(config: Any, seed: int = 0) -> float:
            raise RuntimeError("SMAC is asked and told; it evaluates nothing itself")

        with tempfile.TemporaryDirectory() as folder:
            scenario = smac.Scenario(
                space, deterministic=True, n_trials=budget, seed=seed, output_directory=Path(folder)
            )
            optimiser = getattr(smac, facade)(scenario, never, logging_level=False)
            for _ in range(budget):
                trial = optimiser.ask()
                value = yield [float(trial.config[f"x{i}"]) for i in range(dim)]
                optimiser.tell(trial, TrialValue(cost=value))

    return search


def botorch_log_ei(dim: int, seed: int, budget: int) -> Any:
    """BoTorch's single-task process and its logarithm of the expected improvement, after 20 points of Sobol's."""
    import torch
    from botorch.acquisition import LogExpectedImprovement
    from botorch.fit import fit_gpytorch_mll
    from botorch.models import SingleTaskGP
    from botorch.models.transforms import Standardize
    from botorch.optim import optimize_acqf
    from gpytorch.mlls import ExactMarginalLogLikelihood

    torch.set_num_threads(1)
    torch.manual_seed(seed)
    bounds = torch.tensor([[0.0] * dim, [1.0] * dim], dtype=torch.float64)
    points = torch.quasirandom.SobolEngine(dim, scramble=True, seed=seed).draw(min(20, budget), dtype=torch.float64)
    values: list[float] = []
    for asked in range(budget):
        if asked == len(points):
            y = -torch.tensor(values, dtype=torch.float64)[:, None]
            model = SingleTaskGP(points, y, outcome_transform=Standardize(m=1))
            fit_gpytorch_mll(ExactMarginalLogLikelihood(model.likelihood, model))
            improvement = LogExpectedImprovement(model, best_f=y.max())
            found, _ = optimize_acqf(improvement, bounds, q=1, num_restarts=8, raw_samples=256)
            points = torch.cat([points, found])
        values.append((yield points[asked].tolist()))


PEERS: dict[str, Callable[[int, int, int], Any]] = {
    "random": uniform,
    "optuna-tpe": optuna_with(lambda optuna, seed: optuna.samplers.TPESampler(seed=seed, multivariate=True)),
    "optuna-gp": optuna_with(lambda optuna, seed: optuna.samplers.GPSampler(seed=seed)),
    "optuna-cma": optuna_with(lambda optuna, seed: optuna.samplers.CmaEsSampler(seed=seed)),
    "cma": cma_es,
    "skopt": plain_skopt,
    "nevergrad": nevergrad_ngopt,
    "smac-forest": smac_with("HyperparameterOptimizationFacade"),
    "smac-gp": smac_with("BlackBoxFacade"),
    "botorch": botorch_log_ei,
}


def main() -> None:
    name, dim, seed, budget = sys.argv[1], *map(int, sys.argv[2:5])
    search = PEERS[name](dim, seed, budget)
    value = None
    while True:
        began = time.process_time()
        try:
            point = search.send(value)
        except StopIteration:
            return
        print(json.dumps({"point": point, "s": time.process_time() - began}), flush=True)
        answer = sys.stdin.readline()
        if not answer:
            return
        value = json.loads(answer)


if __name__ == "__main__":
    main()
