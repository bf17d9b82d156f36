"""What storing costs: rates with and without the store, bytes a trajectory, the codec's share, and the time to resume.

    PYTHONPATH=pipeline:store:workflows OMP_NUM_THREADS=1 python benchmarks/store.py [--switches 8192] [--folder /tmp]

Kernel, store and codec are timed in turns in one process, in CPU time of one thread, so that a busy machine disturbs
all of them alike; the medians are compared.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numcodecs import Blosc, blosc

from softclose.ensemble import Responses, simulate
from softclose.population import load_population
from softclose.waveform import Waveform
from softclose_store import DriverStore, Layout, create_campaign, write_chunk

TIMES_US = np.linspace(0.0, 250.0, 1001)
HOLDS = float("inf")
WAVEFORMS = {
    "near the optimum": [(0.0, 6.235, 3.525, 123.32), (6.943, 23.127, HOLDS, 84.78)],
    "unshaped 100 V step": [(0.0, 0.0, HOLDS, 100.0)],
    "poor, closes late": [(0.0, 4.0, 7.0, 150.0), (30.0, 10.0, HOLDS, 85.0)],
}


def arrays(r: Responses) -> dict[str, Any]:
    """The arrays of the store's schema, as the workflow writes them."""
    return {
        "max_contact_speed": r.max_contact_speed,
        "first_contact": r.first_contact_us,
        "settling": r.settling_us,
        "n_impacts": r.n_impacts,
        "final_x": r.final_x,
        "final_v": r.final_v,
        "closed": r.closed,
        "status": r.status,
        "impact_time": r.impact_time_us,
        "impact_speed": r.impact_speed,
        "x": r.x,
        "v": r.v,
    }


def create(path: Path, n_candidates: int, n_switches: int, times_us: np.ndarray[Any, Any]) -> None:
    """A campaign of the default population with one chunk a candidate."""
    population = load_population("current")
    p = population.sample_parameters(n_switches, seed=1)
    s = population.sample(n_switches, seed=1)
    layout = Layout(
        n_candidates=n_candidates,
        n_switches=n_switches,
        chunk_switches=n_switches,
        times_us=times_us,
        max_impacts=64,
        n_pulses=2,
    )
    columns = {"D": p[:, 0], "G": p[:, 1], "E": p[:, 2], "T": p[:, 3], "K": s[:, 2], "M": s[:, 3]}
    create_campaign(path, layout=layout, config={"benchmark": n_switches}, population=columns)


def cpu(function: Callable[[], Any]) -> float:
    """CPU time of one call [s]."""
    start = time.process_time()
    function()
    return time.process_time() - start


def rates(folder: Path, n: int, repeats: int) -> None:
    """Kernel alone against kernel and store, per waveform."""
    path = folder / "rates.zarr"
    create(path, len(WAVEFORMS) * repeats, n, TIMES_US)
    switches = load_population("current").sample(n, seed=1)
    blosc.use_threads = False
    codec = Blosc(cname="lz4", clevel=1, shuffle=Blosc.SHUFFLE, blocksize=65_536)
    print(f"one thread, chunks of {n} switches, float32 at {TIMES_US.size} points; CPU time, median of {repeats}")
    heads = ("kernel", "store", "codec", "rate alone", "with store", "kept", "bytes")
    print(f"{'waveform':20} closed " + " ".join(f"{head:>10}" for head in heads))
    for k, (name, rows) in enumerate(WAVEFORMS.items()):
        waveform = Waveform.from_rows(rows)
        times: dict[str, list[float]] = {"kernel": [], "store": [], "codec": []}
        for repeat in range(repeats):
            results: list[Responses] = []
            times["kernel"].append(
                cpu(
                    lambda w=waveform, out=results: out.append(  # type: ignore[misc]
                        simulate(switches, w, times_us=TIMES_US, dtype=np.float32, max_impacts=64)
                    )
                )
            )
            r = results[0]
            i = k * repeats + repeat
            times["store"].append(cpu(lambda i=i, r=r: write_chunk(path, i, 0, arrays(r), 1)))  # type: ignore[misc]
            times["codec"].append(cpu(lambda r=r: (codec.encode(r.x), codec.encode(r.v))))  # type: ignore[misc]
        kernel, store, share = (float(np.median(times[key])) / n * 1e6 for key in ("kernel", "store", "codec"))
        size = sum(f.stat().st_size for f in path.glob(f"*/c.{k * repeats}.*")) / n
        print(
            f"{name:20} {r.closed.mean():6.2f} {kernel:7.2f} µs {store:7.2f} µs {share:7.2f} µs "
            f"{1e6 / kernel:8,.0f}/s {1e6 / (kernel + store):8,.0f}/s {kernel / (kernel + store):10.0%} "
            f"{size:10.0f}"
        )


RESUME = """
import sys, time
start = time.perf_counter()
from softclose_store import DriverStore
imported = time.perf_counter()
with DriverStore(sys.argv[1]) as store:
    records = store.records()
    store.proposal(store.n_committed)
    print(f"{store.n_committed} candidates: import {imported - start:.2f} s, open and read all records "
          f"{time.perf_counter() - imported:.2f} s")
"""


def resume(folder: Path, n_candidates: int) -> None:
    """Time from opening a long campaign to having all its records in memory."""
    path = folder / "resume.zarr"
    n = 200
    create(path, n_candidates + 1, n, TIMES_US)
    r = simulate(
        load_population("current").sample(n, seed=1),
        Waveform.from_rows(WAVEFORMS["near the optimum"]),
        times_us=TIMES_US,
        dtype=np.float32,
        max_impacts=64,
    )
    start = time.perf_counter()
    with DriverStore(path) as store:
        for i in range(n_candidates):
            store.propose(i, {"waveform": WAVEFORMS["near the optimum"], "n_switches": n, "origin": "benchmark"})
            write_chunk(path, i, 0, arrays(r), store.proposal_digest(i))
            store.commit(i, {"g_cm_s": 20.0 + i})
    print(f"propose, store and commit: {(time.perf_counter() - start) / n_candidates * 1e3:.0f} ms a candidate")
    subprocess.run([sys.executable, "-c", RESUME, str(path)], check=True)


def main() -> None:
    """Run both parts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--switches", type=int, default=8192, help="switches a chunk; 8192 cost the kernel about 50 ms")
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--candidates", type=int, default=500, help="length of the campaign to resume")
    parser.add_argument("--folder", type=Path, default=None, help="where to write; default: a temporary folder")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        rates(Path(folder), options.switches, options.repeats)
        resume(Path(folder), options.candidates)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
