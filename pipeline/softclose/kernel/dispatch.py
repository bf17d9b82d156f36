"""Owns how an ensemble reaches a kernel: flat arrays allocated, switches dealt to threads in contiguous blocks."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.kernel import pieces as drive_pieces
from softclose.kernel import rk, taylor
from softclose.plate import EPSILON_0
from softclose.waveform import Trace, Waveform

FloatArray = NDArray[np.float64]

MAX_STEPS = 200_000
"""Work limit per switch [integration steps]: a thousand times what an ordinary trajectory needs."""

METHODS = ("taylor", "rk")


@dataclass(frozen=True, slots=True, kw_only=True)
class KernelOutput:
    """What a kernel writes, one entry per switch."""

    metrics: FloatArray
    """(5, n): largest contact speed, first contact, settling, final x, final v."""
    n_impacts: NDArray[np.int32]
    closed: NDArray[np.bool_]
    status: NDArray[np.int8]
    impact_time: FloatArray
    impact_speed: FloatArray
    x: NDArray[Any]
    v: NDArray[Any]


def devices(switches: FloatArray, plate_area_um2: float) -> FloatArray:
    """(n, 4) travel D, gap G [µm], c [µm³/(µs² V²)] and k [1/µs²] of Eq. 1 per mass (SPEC §1)."""
    out = np.empty((len(switches), 4))
    out[:, :2] = switches[:, :2]
    out[:, 2] = EPSILON_0 * 1e6 * plate_area_um2 / (2000.0 * switches[:, 3])
    out[:, 3] = switches[:, 2] / (1000.0 * switches[:, 3])
    return out


def run(
    switches: FloatArray,
    waveform: Waveform | Trace,
    *,
    horizon_us: float,
    restitution: float,
    plate_area_um2: float,
    rtol: float,
    times_us: FloatArray,
    method: str,
    threads: int,
    max_impacts: int,
    dtype: type[Any],
    v_stick: float,
    max_steps: int,
) -> KernelOutput:
    """Integrate every switch. Inputs are valid already (`ensemble.simulate`). Each switch is computed on its own."""
    n = len(switches)
    pieces, n_ramps, ramps = drive_pieces.flatten(waveform, horizon_us)
    # An output that is not wanted is one empty row: every call has the same types, so nothing is compiled again.
    n_rows, n_events = (n if len(times_us) else 1), (n if max_impacts else 1)
    out = KernelOutput(
        metrics=np.full((5, n), np.nan),
        n_impacts=np.zeros(n, dtype=np.int32),
        closed=np.zeros(n, dtype=np.bool_),
        status=np.zeros(n, dtype=np.int8),
        impact_time=np.full((n_events, max_impacts), np.nan),
        impact_speed=np.full((n_events, max_impacts), np.nan),
        x=np.empty((n_rows, len(times_us)), dtype=dtype),
        v=np.empty((n_rows, len(times_us)), dtype=dtype),
    )
    table = devices(switches, plate_area_um2)
    samples: tuple[NDArray[Any], ...] = (out.x, out.v)
    block = rk.run_block
    if method == "taylor":
        block = taylor.run_block
        unused = np.empty((1, 0), dtype=np.float32 if dtype == np.float64 else np.float64)
        samples = (out.x, out.v, unused, unused) if dtype == np.float64 else (unused, unused, out.x, out.v)

    def work(lo: int, hi: int) -> None:
        block(
            lo,
            hi,
            table,
            pieces,
            n_ramps,
            ramps,
            restitution,
            v_stick,
            rtol,
            max_steps,
            times_us,
            out.metrics,
            out.n_impacts,
            out.closed,
            out.status,
            out.impact_time,
            out.impact_speed,
            *samples,
        )

    threads = min(threads, n)
    if threads <= 1:
        work(0, n)
        return out
    edges = [n * i // threads for i in range(threads + 1)]
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, edges[:-1], edges[1:]))
    return out
