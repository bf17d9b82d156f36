"""Trajectories per second on one core: this kernel, its Runge-Kutta twin, a plain prototype, scipy and two peers.

All in one run, on distinct switches of the current population, each with the error of V that it makes against the
twin at rtol 1e-12: a speed means nothing without it. The prototype (`plain.py`) is at the loosest tolerance, a power
of ten, that keeps V within some 1e-3 cm/s. The peers, heyoka and diffrax, where they are installed, get fewer
switches, since they are slow, and are timed without their compilation. heyoka and scipy are driven the way a user
would, restarted in Python after each impact. diffrax has no restart: it is timed up to the first contact only, which
flatters it. CPU time, median of the repeats.

    pip install softclose[bench]; python benchmarks/kernel.py [--switches 10000] [--repeats 9] [--peer-switches 100]
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plain import plain
from scipy.integrate import solve_ivp

from softclose import Pulse, Waveform, load_population, simulate
from softclose.kernel.dispatch import devices
from softclose.kernel.pieces import flatten

FloatArray = NDArray[np.float64]
HORIZON_US, ETA, V_STICK = 250.0, 0.5, 1e-5
PLAIN_RTOL = 1e-6
CASES = {
    "step": Waveform([Pulse(0, 0, math.inf, 100)]),
    "two pulses, designed": Waveform([Pulse(0, 4.4, 7.25, 111.6), Pulse(56.5, 19, math.inf, 75)]),
    "two pulses, hard": Waveform([Pulse(0, 4, 11.5, 120), Pulse(24, 12, math.inf, 75)]),
}
Flight = Callable[[int, float, float, float, float], tuple[float, float, float, bool]]


def bounce(table: FloatArray, waveform: Waveform, flight_of: Callable[..., Flight]) -> FloatArray:
    """V of every switch [µm/µs] from a peer's `flight(piece, t, x, v, end) -> (t, x, v, touched)`."""
    pieces, n_ramps, ramps = flatten(waveform, HORIZON_US)
    speeds = np.full(len(table), np.nan)
    for i, (travel, gap, c, k) in enumerate(table):
        flight = flight_of(travel, gap, c, k, pieces, n_ramps, ramps)
        hold = (gap - travel) * math.sqrt(k * travel / c)
        x = v = 0.0
        held = False
        for piece, (start, end, base) in enumerate(pieces):
            t = start
            while t < end and not held:
                t, x, v, touched = flight(piece, t, x, v, end)
                if touched:
                    speeds[i] = max(v, np.nan_to_num(speeds[i]))
                    x, v = travel, -ETA * v
                    volts = base + sum(a * math.cos(w * (t - o)) for a, w, o in ramps[piece, : n_ramps[piece]])
                    held = -v < V_STICK and volts >= hold  # these waveforms release nothing that they hold
    return speeds


def scipy_flight(travel: float, gap: float, c: float, k: float, pieces: Any, n_ramps: Any, ramps: Any) -> Flight:
    def contact(t: float, y: FloatArray) -> float:
        return float(y[0]) - travel

    contact.terminal, contact.direction = True, 1.0  # type: ignore[attr-defined]

    def flight(piece: int, t: float, x: float, v: float, end: float) -> tuple[float, float, float, bool]:
        base, terms = float(pieces[piece, 2]), [tuple(r) for r in ramps[piece, : n_ramps[piece]].tolist()]

        def rhs(s: float, y: FloatArray) -> tuple[float, float]:
            u = base
            for a, w, o in terms:
                u += a * math.cos(w * (s - o))
            return y[1], c * (u / (gap - y[0])) ** 2 - k * y[0]

        max_step = 0.5
        if x == travel:  # the first step must resolve the bounce, or its end is not seen
            max_step = min(0.5, max(-v * 0.5 / max(abs(rhs(t, np.array([x, v]))[1]), 1e-9), 1e-9))
            leg = solve_ivp(rhs, (t, min(t + max_step, end)), (x, v), "DOP853", rtol=1e-8, atol=1e-11)
            t, x, v = leg.t[-1], leg.y[0, -1], leg.y[1, -1]
            max_step = min(0.5, 40 * max_step)
        leg = solve_ivp(rhs, (t, end), (x, v), "DOP853", rtol=1e-8, atol=1e-11, max_step=max_step, events=contact)
        return float(leg.t[-1]), float(leg.y[0, -1]), float(leg.y[1, -1]), leg.status == 1

    return flight


def prototype(table: FloatArray, waveform: Waveform, times_us: FloatArray) -> FloatArray:
    """V of every switch from the plain prototype."""
    return plain(table, waveform, HORIZON_US, times_us, PLAIN_RTOL)[0]


def heyoka_peer() -> Callable[..., Flight]:
    import heyoka as hy

    x, v = hy.make_vars("x", "v")
    p = hy.par
    u = p[4] + p[5] * hy.cos(p[6] * (hy.time - p[7])) + p[8] * hy.cos(p[9] * (hy.time - p[10]))
    # At a looser tolerance its event cooldown skips small bounces, and x runs on into the gap.
    contact = hy.t_event(x - p[0], direction=hy.event_direction.positive)
    force = p[2] * (u / (p[1] - x)) ** 2 - p[3] * x
    ta = hy.taylor_adaptive([(x, v), (v, force)], [0.0, 0.0], tol=1e-10, t_events=[contact])

    def flight_of(travel: float, gap: float, c: float, k: float, pieces: Any, n_ramps: Any, ramps: Any) -> Flight:
        def flight(piece: int, t: float, x0: float, v0: float, end: float) -> tuple[float, float, float, bool]:
            terms = np.zeros((2, 3))
            terms[:, 1] = 1.0
            terms[: n_ramps[piece]] = ramps[piece, : n_ramps[piece]]
            ta.pars[:] = [travel, gap, c, k, pieces[piece, 2], *terms.ravel()]
            if x0 < travel or ta.time != t:
                ta.reset_cooldowns()
            ta.time = t
            ta.state[:] = x0, v0
            outcome = ta.propagate_until(end)[0]
            touched = outcome != hy.taylor_outcome.time_limit
            return float(ta.time), float(ta.state[0]), float(ta.state[1]), touched

        return flight

    return flight_of


def diffrax_peer() -> Callable[[FloatArray, Waveform], FloatArray]:
    import jax

    jax.config.update("jax_enable_x64", True)
    import diffrax as dfx
    import jax.numpy as jnp
    import optimistix as optx

    def volts(t: Any, rows: Any) -> Any:
        start, rise, peak, height = rows.T
        s = jnp.clip((t - start) / jnp.maximum(rise, 1e-12), 0.0, 1.0)
        fall = jnp.clip((t - start - rise - peak) / jnp.maximum(rise, 1e-12), 0.0, 1.0)
        return jnp.sum(height * 0.5 * (jnp.cos(jnp.pi * fall) - jnp.cos(jnp.pi * s)))

    def field(t: Any, y: Any, args: Any) -> Any:
        device, rows = args
        u = volts(t, rows)
        return jnp.array([y[1], device[2] * (u / (device[1] - y[0])) ** 2 - device[3] * y[0]])

    def contact(t: Any, y: Any, args: Any, **_: Any) -> Any:
        return y[0] - args[0][0]

    event = dfx.Event(contact, optx.Newton(1e-9, 1e-9), direction=True)
    controller = dfx.PIDController(rtol=1e-8, atol=1e-10, dtmax=2.0)

    def one(device: Any, rows: Any) -> Any:
        args = (device, rows)
        out = dfx.diffeqsolve(
            dfx.ODETerm(field),
            dfx.Dopri8(),
            0.0,
            HORIZON_US,
            0.1,
            jnp.zeros(2),
            args,
            event=event,
            stepsize_controller=controller,
            max_steps=4096,
            throw=False,
        )
        return jnp.where(out.ts[-1] < HORIZON_US, out.ys[-1, 1], jnp.nan)

    batch = jax.jit(jax.vmap(one, in_axes=(0, None)))

    def run(table: FloatArray, waveform: Waveform) -> FloatArray:
        rows = waveform.rows()
        rows[np.isinf(rows[:, 2]), 2] = 1e9
        return np.asarray(batch(table, rows))

    return run


def timed(run: Callable[[], FloatArray], repeats: int) -> tuple[float, FloatArray]:
    """Median CPU seconds, and what was computed. Called once before: compilation and caches do not count."""
    result = run()
    seconds = []
    for _ in range(repeats):
        start = time.process_time()
        run()
        seconds.append(time.process_time() - start)
    return float(np.median(seconds)), result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--switches", type=int, default=10_000)
    parser.add_argument("--peer-switches", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=9)
    args = parser.parse_args()
    switches = load_population("current").sample(args.switches, seed=3)
    few = switches[: args.peer_switches]
    table, whole = devices(few, 16700.0), devices(switches, 16700.0)
    grid, none = np.linspace(0.0, HORIZON_US, 1001), np.zeros(0)
    heyoka: Callable[..., Flight] | None = None
    diffrax: Callable[[FloatArray, Waveform], FloatArray] | None = None
    try:
        heyoka = heyoka_peer()
    except ImportError as e:
        print(f"heyoka left out: {e}")
    try:
        diffrax = diffrax_peer()
    except ImportError as e:
        print(f"diffrax left out: {e}")
    start = time.perf_counter()
    simulate(few[:1], CASES["step"])
    print(f"first call of this process: {time.perf_counter() - start:.2f} s (compiles once per machine, then cached)")
    for name, waveform in CASES.items():
        tight = simulate(switches, waveform, method="rk", rtol=1e-12, max_impacts=1)
        assert tight.impact_speed is not None
        every, first = tight.max_contact_speed, tight.impact_speed[:, 0]

        def ours(w: Waveform = waveform, **settings: Any) -> FloatArray:
            return simulate(switches, w, **settings).max_contact_speed

        rows: list[tuple[str, Callable[[], FloatArray], FloatArray, int]] = [
            ("kernel", ours, every, args.repeats),
            ("kernel, x and v on 1001 points", partial(ours, times_us=grid, dtype=np.float32), every, args.repeats),
            ("plain prototype", partial(prototype, whole, waveform, none), every, 3),
            ("plain prototype, x and v", partial(prototype, whole, waveform, grid), every, 3),
            ("RK twin, rtol 1e-8", partial(ours, method="rk", rtol=1e-8), every, 3),
        ]
        if heyoka is not None:
            rows.append(("heyoka, tol 1e-10", partial(bounce, table, waveform, heyoka), every[: len(few)], 1))
        if diffrax is not None:
            rows.append(("diffrax, to first contact", partial(diffrax, table, waveform), first[: len(few)], 1))
        rows.append(("scipy DOP853, rtol 1e-8", partial(bounce, table[:20], waveform, scipy_flight), every[:20], 1))
        print(f"\n{name}")
        base = math.nan
        for label, run, reference, repeats in rows:
            seconds, v = timed(run, repeats)
            rate = len(reference) / seconds
            base = rate if math.isnan(base) else base
            both = np.isfinite(v) & np.isfinite(reference)
            error = 100.0 * np.abs(v - reference)[both]
            differ = int((np.isfinite(v) != np.isfinite(reference)).sum())
            print(
                f"  {label:32s}{rate:12,.0f} /s  ratio {base / rate:8.1f}  error of V [cm/s]: 99 % "
                f"{np.quantile(error, 0.99):.0e}, largest {error.max():.0e}; contact differs: {differ}"
            )


if __name__ == "__main__":
    main()
