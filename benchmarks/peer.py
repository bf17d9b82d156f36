"""One peer, in an environment of its own: points of the unit cube out, values in, a line of JSON each. Knows nothing of
Softclose, and needs nothing but the package that it asks.

    python peer.py optuna-tpe DIMENSIONS SEED BUDGET
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

Search = Iterator[list[float]]


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


PEERS: dict[str, Callable[[int, int, int], Any]] = {
    "optuna-tpe": optuna_with(lambda optuna, seed: optuna.samplers.TPESampler(seed=seed, multivariate=True)),
    "optuna-gp": optuna_with(lambda optuna, seed: optuna.samplers.GPSampler(seed=seed)),
    "optuna-cma": optuna_with(lambda optuna, seed: optuna.samplers.CmaEsSampler(seed=seed)),
    "cma": cma_es,
    "skopt": plain_skopt,
    "nevergrad": nevergrad_ngopt,
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
