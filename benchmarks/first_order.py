"""What does a first-order robust design leave on the table? Its certified v_u beside the lot's optimum. Prints a table.

The design knows the mean switch only: V there and dV/dp for D, G, E and T by central differences. It minimises
V + 1.2816 sqrt(sum (dV/dp s_p)²), which is the 90 % quantile of V where V is linear and the lot normal.

python benchmarks/first_order.py --seeds 1-5
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from scipy.optimize import differential_evolution

from softclose import simulate
from softclose.arrays import FloatArray
from softclose.evaluate import judge
from softclose.metrics.objective import CM_S
from softclose.population import switches_from_parameters
from softclose.propose.protocol import Problem
from softclose.settings import CampaignConfig, load_config
from softclose.waveform import Waveform
from softclose_workflows.analyses.certify import simulate_fresh

NORMAL_90 = 1.2815515655446004
STEP = 0.5
"""Of the central differences, in standard deviations."""
NOT_CLOSED_CM_S = 100.0


def star(config: CampaignConfig) -> FloatArray:
    """(9, 6) the mean switch, then each parameter STEP standard deviations below and above its mean."""
    population = config.build_population()
    members = [population.D, population.G, population.E, population.T]
    mean, deviation = np.array([m.mean for m in members]), np.array([m.sd for m in members])
    moves = STEP * np.diag(deviation)
    return switches_from_parameters(np.vstack([mean, *(mean + sign * row for row in moves for sign in (-1.0, 1.0))]))


def first_order(switches: FloatArray, waveform: Waveform) -> float:
    """V + 1.2816 sqrt(sum (dV/dz)²) [cm/s], z in standard deviations."""
    r = simulate(switches, waveform)
    open_ = int((~r.closed).sum())
    if open_:
        return NOT_CLOSED_CM_S * open_
    v = r.max_contact_speed * CM_S
    slopes = (v[2::2] - v[1::2]) / (2.0 * STEP)
    return float(v[0] + NORMAL_90 * math.sqrt(float(slopes @ slopes)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--preset", default="current-three")
    parser.add_argument("--seeds", default="1-5", help="first-last")
    parser.add_argument("--generations", type=int, default=600)
    parser.add_argument("--switches", type=int, default=100_000)
    options = parser.parse_args()
    config = load_config(options.preset)
    space, switches = Problem(config).space, star(config)
    first, last = (int(v) for v in options.seeds.split("-"))
    print("| seed | waveforms tried | v_u by first order | v_u certified | p_nc | g certified |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: |")
    for seed in range(first, last + 1):

        def value(point: FloatArray) -> float:
            return first_order(switches, space.waveforms(point[None])[0])

        found = differential_evolution(
            value, [(0.0, 1.0)] * space.dim, seed=seed, maxiter=options.generations, popsize=15, tol=0.0, polish=False
        )
        waveform = space.waveforms(found.x[None])[0]
        (fresh,) = simulate_fresh(config, [waveform], n_switches=options.switches, seed=seed)
        a = judge(config, fresh, fresh=True)
        print(
            f"| {seed} | {found.nfev:,} | {found.fun:.2f} | {a.v_u_cm_s:.2f} ({a.v_u_interval[0]:.2f}–"
            f"{a.v_u_interval[1]:.2f}) | {a.p_nc:.3f} | {a.g_cm_s:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
