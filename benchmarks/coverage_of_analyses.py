"""Coverage of the intervals of the analyses that make their own: tails, Sobol' indices, fitted lots, `propagate`.

Sections of benchmarks/interval_coverage.py, which is the command. Switches whose V is a stated function of their
coordinates stand in for the simulator, so that the truth is a closed form; `propagate` is simulated.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from softclose import Waveform
from softclose.conditions.streams import Ensemble
from softclose.evaluate import draw, evaluate
from softclose.evaluate.pieces import Mapper, here
from softclose.metrics.objective import CM_S
from softclose.population import load_population
from softclose.population.calibrate import calibrate
from softclose.population.distributions import Bounded
from softclose.population.fit import fit
from softclose.population.measurements import Measurements
from softclose.population.population import switches_from_parameters
from softclose.settings import load_config
from softclose.switch.plate import pull_in_voltage
from softclose.uncertainty import devices, sensitivity, tails

FloatArray = NDArray[np.float64]

DRIVE = Waveform.from_rows([(0.0, 4.0, 3.2, 150.0), (25.0, 20.0, None, 75.0)])
SOFT = Waveform.from_rows([(0.0, 4.0, 4.78, 84.95), (32.46, 4.33, 6.2, 149.76), (45.94, 13.24, None, 75.39)])
DIRECTION = np.array([0.5, -0.5, 0.5, 0.5])


def _heading(title: str, columns: Iterable[str]) -> None:
    names = list(columns)
    print(f"\n## {title}\n\n| " + " | ".join(names) + " |\n|" + " --- |" * len(names))


def _shares(held: Iterator[NDArray[np.bool_]], repetitions: int) -> FloatArray:
    """Coverage of each of several intervals; what it is so far, each five hundred repetitions, on standard error."""
    total: Any = 0
    for k in range(repetitions):
        total = total + next(held).astype(np.int64)
        if (k + 1) % 500 == 0:
            print(f"{k + 1} of {repetitions}:", (total / (k + 1)).tolist(), file=sys.stderr, flush=True)
    return np.asarray(total / repetitions)


def known_tails() -> ExitStack:
    """A lot whose V is normal, 10 + 2 z cm/s, where z is along a fixed direction of its coordinates."""

    def measure(asked: Any, u: FloatArray) -> tuple[FloatArray, int]:
        return 10.0 + 2.0 * (u @ DIRECTION), 0

    def drawn(config: Any, n: int, *, seed: int, start: int, ensemble: Ensemble) -> FloatArray:
        return np.random.default_rng((seed, start)).standard_normal((n, DIRECTION.size))

    stack = ExitStack()
    for name, value in (("_lot_at", lambda config, u: u), ("_measure", measure), ("draw", drawn)):
        stack.enter_context(patch.object(tails, name, value))
    return stack


def print_tails(repetitions: int, error: float = 0.2, probabilities: Iterable[float] = (0.6, 0.08, 0.02, 1e-4)) -> None:
    """Brute force, importance and subset sampling of a probability known by a closed form."""
    _heading(f"Tails (relative error {error:g})", ("p", "repetitions", "brute, 2,000 switches", "importance", "subset"))
    config = load_config({})
    with known_tails():
        for p in probabilities:
            limit = 10.0 + 2.0 * float(norm.isf(p))

            def held(p: float = p, limit: float = limit) -> Iterator[NDArray[np.bool_]]:
                seed = 0
                while True:
                    rows = tails.tail(
                        config, DRIVE, "fast", limit_cm_s=limit, methods=("brute", "importance", "subset"),
                        n_switches=2_000, relative_error=error, seed=seed,
                    )  # fmt: skip
                    yield np.array([r.interval[0] <= p <= r.interval[1] for r in rows])
                    seed += 1

            shares = _shares(held(), repetitions)
            print(f"| {p:g} | {repetitions:,} | " + " | ".join(f"{s:.3f}" for s in shares) + " |", flush=True)


Surface = Callable[[FloatArray], FloatArray]


def _step(x: FloatArray) -> NDArray[np.bool_]:
    """A switch that closes where the first of its variables is beyond 0.9 of its range: both shares of it are 1."""
    return np.asarray(x[:, 0] > 0.4)


SURFACES: dict[str, tuple[Surface, FloatArray, FloatArray]] = {
    # On uniforms centred at 0; first and total shares of the first four variables.
    "additive, 1 : 2 : 3 : 4": (
        lambda x: x @ np.array([1.0, 2.0, 3.0, 4.0]),
        np.array([1.0, 4.0, 9.0, 16.0]) / 30.0,
        np.array([1.0, 4.0, 9.0, 16.0]) / 30.0,
    ),
    # x1 + x1 x2 / s with s the deviation of x: the product has the variance of x1.
    "half an interaction": (
        lambda x: x[:, 0] * (1.0 + x[:, 1] * math.sqrt(12.0)),
        np.array([0.5, 0.0, 0.0, 0.0]),
        np.array([1.0, 0.5, 0.0, 0.0]),
    ),
}
"""What V is made of. Whether a switch closes is a step in the first variable, for which both are (1, 0, 0, 0)."""


def print_sensitivity(repetitions: int, n: int = 256) -> None:
    """First-order and total Sobol' indices of surfaces that have them in closed form: the least over variables.

    Each analysis has two outputs, V and closing: beside the first surface stands the step.
    """
    _heading(f"Sobol' indices ({n} points, 8 scramblings)", ("surface", "repetitions", "first", "total"))
    population = load_population("current")
    stepped = np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
    for k, (name, (surface, first, total)) in enumerate(SURFACES.items()):

        def respond(config: Any, lot: FloatArray, waveform: Any, surface: Surface = surface) -> Any:
            v = surface(lot)
            return SimpleNamespace(
                max_contact_speed=v / CM_S, closed=_step(lot),
                status=np.zeros(v.size, dtype=np.int8), settling_us=np.zeros(v.size),
            )  # fmt: skip

        def realised(config: Any, u: dict[str, FloatArray]) -> FloatArray:
            return np.column_stack(list(u.values()))[:, :4] - 0.5

        truth = np.stack([np.stack([first, total]), stepped])

        def held(truth: FloatArray = truth) -> Iterator[NDArray[np.bool_]]:
            seed = 0
            while True:
                indices = sensitivity.sensitivity(population, DRIVE, n=n, seed=seed).indices
                rows = [[i for i in indices if i.output == output][:4] for output in sensitivity.OUTPUTS]
                ends = np.array([[[i.first_interval for i in of], [i.total_interval for i in of]] for of in rows])
                slack = 1e-9
                yield (ends[..., 0] <= truth + slack) & (truth <= ends[..., 1] + slack)
                seed += 1

        with patch.object(sensitivity, "respond", respond), patch.object(sensitivity, "realise", realised):
            shares = _shares(held(), repetitions).min(axis=2)
        for title, row in zip((name, "a step at 0.9") if k == 0 else (name,), shares, strict=False):
            print(f"| {title} | {repetitions:,} | " + " | ".join(f"{s:.3f}" for s in row) + " |", flush=True)


def print_fitted(repetitions: int, lots: int = 500, sizes: Iterable[int] = (12, 60)) -> None:
    """Numbers of a Beta with alpha + beta = 4 fitted to a handful of devices, bounds unknown.

    The lots that are tried are the same for any data: a hundred repetitions after one another share them, of every
    alpha.
    """
    names = ("lower", "upper", "mean", "sd")
    _heading(f"Fitted lots ({lots} lots tried)", ("devices", "alpha", "repetitions", *names))
    for n in sizes:
        true = [Bounded(lower=1.0, upper=3.0, alpha=alpha, beta=4.0 - alpha) for alpha in (1.07, 1.3, 2.0, 2.7)]
        truth = np.array([[b.lower, b.upper, b.mean, b.sd] for b in true])

        def held(n: int = n, true: list[Bounded] = true, truth: FloatArray = truth) -> Iterator[NDArray[np.bool_]]:
            rngs = [np.random.default_rng((n, round(100 * b.alpha))) for b in true]
            for i in itertools.count():
                ends = []
                for b, rng in zip(true, rngs, strict=True):
                    values = b.lower + (b.upper - b.lower) * rng.beta(b.alpha, b.beta, n)
                    numbers = fit(values, "beta", n_bootstrap=lots, seed=i // 100).numbers
                    ends.append([numbers[k].interval for k in names])
                low, high = np.moveaxis(np.array(ends), 2, 0)
                yield (low <= truth) & (truth <= high)

        for b, shares in zip(true, _shares(held(), repetitions), strict=True):
            cells = " | ".join(f"{s:.3f}" for s in shares)
            print(f"| {n} | {b.alpha:g} | {repetitions:,} | {cells} |", flush=True)


def judged_until_clear(truth: Mapping[str, float], n_lots: int) -> Mapper:
    """A mapper for `propagate` that stops once it is certain that its intervals hold the truth.

    An interval's ends are the percentiles of what the lots have, each between two neighbours of their order: where as
    many lots as lie beyond them are on either side of the truth, the truth is inside, whatever the other lots have.
    These get the figures of one that was judged. Where it does not become clear, every lot is judged.
    """
    needed = math.floor(0.025 * (n_lots - 1)) + 2

    def mapper(function: Callable[[Any], Any], pieces: Iterable[Any]) -> Iterator[Any]:
        _, *lots = pieces  # the first is the lot as fitted, of which no interval asks
        found: list[Any] = []
        for lot in lots:
            found.append(function(lot))
            values = {name: np.array([getattr(a, name) for a in found]) for name in truth}
            if all(min((v <= truth[k]).sum(), (v >= truth[k]).sum()) >= needed for k, v in values.items()):
                break
        return iter([found[0], *found, *[found[0]] * (len(lots) - len(found))])

    return mapper


def print_devices(repetitions: int, n_devices: int = 12, lots: int = 80, switches: int = 800) -> None:
    """`propagate` without bounds: devices of the lot `current`, the soft waveform, simulated.

    A hundred repetitions after one another share the lots that are tried, and their switches.
    """
    _heading(f"What {n_devices} devices leave open ({lots} lots of {switches})", ("repetitions", "v_u", "p_nc"))
    shares = _shares(devices_hold(n_devices, lots, switches), repetitions)
    print(f"| {repetitions:,} | " + " | ".join(f"{s:.3f}" for s in shares) + " |", flush=True)


def devices_hold(n_devices: int, lots: int, switches: int, *, all_lots: bool = False) -> Iterator[NDArray[np.bool_]]:
    """Whether the intervals of v_u and p_nc hold, of one set of devices after another."""
    config, true = load_config("current"), load_population("current")
    right = evaluate(config, draw(config, 200_000, seed=10_000, sampling="sobol"), SOFT)
    truth = {"v_u_cm_s": right.v_u_cm_s, "p_nc": right.p_nc}
    mapper = here if all_lots else judged_until_clear(truth, lots)
    for i in itertools.count():
        p = true.sample_parameters(n_devices, seed=i + 1)
        measured = Measurements(
            device=tuple(map(str, range(n_devices))), G_um=p[:, 1], D_um=p[:, 0], T_um=p[:, 3],
            pull_in_V=pull_in_voltage(switches_from_parameters(p)),
        )  # fmt: skip
        fitted = calibrate(measured, n_bootstrap=20).population
        found = devices.propagate(
            config, SOFT, fitted, n_devices, n_lots=lots, n_switches=switches, seed=i // 100, mapper=mapper
        )
        ends = [found.interval(name) for name in truth]
        yield np.array([low <= t <= high for (low, high), t in zip(ends, truth.values(), strict=True)])
