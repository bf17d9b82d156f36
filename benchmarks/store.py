"""What storing costs: rates with and without the store, bytes a trajectory, codecs, commits, and the time to resume.

    PYTHONPATH=pipeline:store:workflows OMP_NUM_THREADS=1 python benchmarks/store.py [rates] [codecs] [waves] [door]

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
import zarr
from numcodecs import Blosc, Delta, blosc

from softclose.device.simulate import Responses, simulate
from softclose.population import load_population
from softclose.waveform import Waveform
from softclose_store import (
    DriverStore,
    Layout,
    StageLayout,
    create_campaign,
    open_campaign,
    proposals_digest,
    write_block,
)
from softclose_store.disk.files import open_files
from softclose_store.schema.digests import block_digest
from softclose_store.schema.opening import read_root

TIMES_US = np.linspace(0.0, 250.0, 1001)
HOLDS = float("inf")
WAVEFORMS = {
    "near the optimum": [(0.0, 6.235, 3.525, 123.32), (6.943, 23.127, HOLDS, 84.78)],
    "unshaped 100 V step": [(0.0, 0.0, HOLDS, 100.0)],
    "poor, closes late": [(0.0, 4.0, 7.0, 150.0), (30.0, 10.0, HOLDS, 85.0)],
}
MAX_IMPACTS = 64


def arrays(r: Responses, n_candidates: int) -> dict[str, Any]:
    """The arrays of a block: responses of (candidates x switches) in one go, folded."""
    response = np.column_stack(
        [r.max_contact_speed, r.first_contact_us, r.settling_us, r.n_impacts, r.final_x, r.final_v, r.closed, r.status]
    )
    impact = np.stack([r.impact_time_us, r.impact_speed], axis=-1)
    flat = {"response": response, "impact": impact, "x": r.x, "v": r.v}
    return {name: values.reshape(n_candidates, -1, *values.shape[1:]) for name, values in flat.items()}


def create(path: Path, stage: StageLayout, *, thin: bool = False) -> Layout:
    """A campaign of one stage, of the default population; thin keeps neither trajectories nor impacts."""
    n = stage.n_switches
    population = load_population("current")
    p, s = population.sample_parameters(n, seed=1), population.sample(n, seed=1)
    layout = Layout(
        stages=(stage,), times_us=np.empty(0) if thin else TIMES_US, max_impacts=0 if thin else MAX_IMPACTS, n_pulses=3
    )
    columns = {"D": p[:, 0], "G": p[:, 1], "E": p[:, 2], "T": p[:, 3], "K": s[:, 2], "M": s[:, 3]}
    create_campaign(path, layout=layout, config={"benchmark": n}, population=columns, algorithm="benchmark")
    return layout


def cpu(function: Callable[[], Any]) -> float:
    """CPU time of one call [s]."""
    start = time.process_time()
    function()
    return time.process_time() - start


def respond(switches: np.ndarray[Any, Any], rows: list[tuple[float, ...]]) -> Responses:
    """The responses of switches of the default population."""
    return simulate(switches, Waveform.from_rows(rows), times_us=TIMES_US, dtype=np.float32, max_impacts=MAX_IMPACTS)


def rates(folder: Path, repeats: int) -> None:
    """Kernel alone against kernel and store, per shape of a block and waveform."""
    blosc.use_threads = False
    codec = Blosc(cname="lz4", clevel=1, shuffle=Blosc.SHUFFLE, blocksize=65_536)
    print(f"one thread, float32 at {TIMES_US.size} points; CPU time, median of {repeats}")
    heads = ("kernel", "store", "codec", "rate alone", "with store", "kept", "bytes")
    print(f"{'block':>8} {'waveform':20} " + " ".join(f"{head:>10}" for head in heads))
    for shape in ((20, 256), (2, 2_000), (1, 5_000)):
        n = shape[0] * shape[1]
        stage = StageLayout(
            name="search",
            n_candidates=shape[0] * len(WAVEFORMS) * repeats,
            n_switches=shape[1],
            block_candidates=shape[0],
            block_switches=shape[1],
        )
        path = folder / f"rates-{n}.zarr"
        switches = load_population("current").sample(n, seed=1)
        create(path, stage)
        for k, (name, rows) in enumerate(WAVEFORMS.items()):
            respond(switches, rows)
            times: dict[str, list[float]] = {"kernel": [], "store": [], "codec": []}
            for i in range(k * repeats, (k + 1) * repeats):
                results: list[Responses] = []
                times["kernel"].append(cpu(lambda w=rows, out=results, s=switches: out.append(respond(s, w))))  # type: ignore[misc]
                r = results[0]
                block = arrays(r, shape[0])
                times["store"].append(cpu(lambda i=i, b=block, p=path: write_block(p, "search", i, 0, b, 1)))  # type: ignore[misc]
                times["codec"].append(cpu(lambda r=r: (codec.encode(r.x), codec.encode(r.v))))  # type: ignore[misc]
            kernel, store, share = (float(np.median(times[key])) / n * 1e6 for key in ("kernel", "store", "codec"))
            size = sum(f.stat().st_size for f in path.glob(f"search/*/c.{k * repeats}.*")) / n
            both = kernel + store
            print(
                f"{shape[0]:>2}x{shape[1]:<5} {name:20} {kernel:7.2f} µs {store:7.2f} µs {share:7.2f} µs "
                f"{1e6 / kernel:8,.0f}/s {1e6 / both:8,.0f}/s {kernel / both:10.0%} {size:10.0f}"
            )


def codecs(repeats: int) -> None:
    """Bytes and times of x and v of 4,096 switches by codec; differences are taken of the bits, as integers."""
    blosc.use_threads = False
    delta = Delta(dtype="<i4")
    filters: dict[str, Callable[[Any], Any]] = {
        "as they are": lambda a: a,
        "differences": delta.encode,
        "second differences": lambda a: delta.encode(delta.encode(a)),
        "time first": lambda a: np.ascontiguousarray(a.T),
    }
    kinds = [("lz4", 1, "byte"), ("lz4", 5, "byte"), ("lz4", 1, "bit"), ("zstd", 1, "byte"), ("zstd", 1, "bit")]
    print(f"{'waveform':20} {'filter':20} codec          bytes   filter   encode   decode  (µs a trajectory)")
    for name, rows in WAVEFORMS.items():
        n = 4096
        r = respond(load_population("current").sample(n, seed=1), rows)
        for what, prepare in filters.items():
            for cname, level, shuffle in kinds:
                for size in (65_536, 262_144):
                    mode = Blosc.BITSHUFFLE if shuffle == "bit" else Blosc.SHUFFLE
                    codec = Blosc(cname=cname, clevel=level, shuffle=mode, blocksize=size)
                    ready = [prepare(a) for a in (r.x, r.v)]
                    done = [codec.encode(a) for a in ready]
                    steps = (
                        lambda p=prepare, r=r: [p(a) for a in (r.x, r.v)],
                        lambda c=codec, a=ready: [c.encode(b) for b in a],
                        lambda c=codec, a=done: [c.decode(b) for b in a],
                    )
                    spent = [min(cpu(step) for _ in range(repeats)) / n * 1e6 for step in steps]
                    n_bytes = sum(map(len, done)) / n
                    print(
                        f"{name:20} {what:20} {cname}{level} {shuffle:4} {size // 1024:3}k {n_bytes:6.0f} "
                        + " ".join(f"{t:8.2f}" for t in spent)
                    )


RESUME = """
import sys, time
start = time.process_time()
from softclose_store import DriverStore
imported = time.process_time()
with DriverStore(sys.argv[1]) as store:
    store.records()
    print(f"{store.n_committed} candidates: import {imported - start:.2f} s, open and read all records "
          f"{time.process_time() - imported:.2f} s (CPU)")
"""


def waves(folder: Path, n_candidates: int) -> None:
    """The driver's share: proposals' digests and commits of waves of 80 and of 1, first ones against last ones."""
    from softclose_store.schema.fields import RESULTS

    rng = np.random.default_rng(0)
    numbers = [field.name for field in RESULTS if field.type == "float" and not field.per_limit]
    for size, per_block in ((80, 20), (1, 1)):
        n = min(n_candidates, 400) if size == 1 else n_candidates
        stage = StageLayout(name="search", n_candidates=n, n_switches=2, block_candidates=per_block, block_switches=2)
        path = folder / f"waves-{size}.zarr"
        layout = create(path, stage, thin=True)
        spent, wall = [], []
        with DriverStore(path) as store:
            while store.n_committed < n:
                start = store.n_committed
                rows = [
                    {
                        "waveform": rng.random((3, 4)),
                        "n_switches": 2,
                        "origin": "benchmark",
                        "surrogate": {"noise": 1.0},
                    }
                    | {name: rng.random() for name in numbers}
                    for _ in range(min(size, n - start))
                ]
                markers = {}
                for i, j in layout.wave_blocks(start, len(rows), 2):
                    own = rows[i * per_block - start : (i + 1) * per_block - start]
                    digest = proposals_digest([row["waveform"] for row in own], 2, i * per_block)
                    response = rng.random((len(own), 2, 8))
                    markers[i, j] = write_block(path, "search", i, j, {"response": response}, digest)
                begun = time.perf_counter()
                spent.append(cpu(lambda r=rows, m=markers, s=store: s.commit(r, m)) * 1e3)  # type: ignore[misc]
                wall.append((time.perf_counter() - begun) * 1e3)
        k = max(len(spent) // 5, 3)
        files = sum(1 for f in path.rglob("*") if f.is_file())
        print(
            f"waves of {size}: commit {np.median(spent):.1f} ms CPU ({np.median(wall):.1f} ms), first fifth "
            f"{np.median(spent[:k]):.1f}, last fifth {np.median(spent[-k:]):.1f}; {files} files for {n} candidates"
        )
        for _ in range(3):
            subprocess.run([sys.executable, "-c", RESUME, str(path)], check=True)


def filled(path: Path, shape: tuple[int, int], n_candidates: int) -> None:
    """A campaign of so many candidates, shape (candidates, switches) a block, all of one waveform's responses."""
    per_block, n_switches = shape
    stage = StageLayout(
        name="search",
        n_candidates=n_candidates,
        n_switches=n_switches,
        block_candidates=per_block,
        block_switches=n_switches,
    )
    create(path, stage)
    rows = WAVEFORMS["near the optimum"]
    r = respond(load_population("current").sample(per_block * n_switches, seed=1), rows)
    block, proposed = arrays(r, per_block), {"waveform": rows, "n_switches": n_switches, "origin": "benchmark"}
    with DriverStore(path) as store:
        for i in range(n_candidates // per_block):
            digest = proposals_digest([rows] * per_block, n_switches, i * per_block)
            marker = write_block(path, "search", i, 0, block, digest)
            store.commit([proposed | {"g_cm_s": 20.0}] * per_block, {(i, 0): marker})


def everything(path: Path) -> None:
    """All responses and motions of a campaign, as `Campaign` hands them out: compared with what was written."""
    campaign = open_campaign(path)
    for i in range(campaign.committed):
        campaign.responses(i)
        motion = campaign.trajectories(i)
        motion.x[...], motion.v[...]


def by_zarr(path: Path, n: int, step: int) -> None:
    """The same arrays by zarr alone, so many candidates at a time: believed."""
    group = zarr.open_group(path, mode="r")["search"]
    for i in range(0, n, step):
        for name in ("response", "x", "v"):
            group[name][i : i + step]


def door(folder: Path, repeats: int) -> None:
    """What it costs to compare everything with its digests before it is believed, of reading it at all."""
    blosc.use_threads = False  # which it has in the main thread only, where zarr does not decode
    for shape, n in (((20, 256), 200), ((1, 5_000), 12)):
        path = folder / f"door-{shape[1]}.zarr"
        filled(path, shape, n)
        campaign = open_campaign(path)
        table, files = campaign._table(), open_files(path, read_only=True)
        blocks = [campaign._blocks._read("search", name, 0, 0) for name in ("response", "x", "v")]
        parts: dict[str, tuple[int, Callable[..., Any], tuple[Any, ...]]] = {
            "everything, compared": (1, everything, (path,)),
            "by zarr, block by block": (1, by_zarr, (path, n, shape[0])),
            "by zarr, one by one": (1, by_zarr, (path, n, 1)),
            "of that: root and schema": (1, read_root, (files, str(path))),
            "rows of the tables": (1, table.check, (campaign._files, n)),
            "digests of blocks": (n // shape[0], digests_of, (blocks,)),
        }
        print(f"{n} candidates of {shape[1]} switches, {shape[0]} a block (CPU, median of {repeats})")
        spent = {}
        for name, (times, part, given) in parts.items():
            spent[name] = times * float(np.median([cpu(lambda p=part, g=given: p(*g)) for _ in range(repeats)]))  # type: ignore[misc]
            print(f"  {name:26} {spent[name] * 1e3:9.2f} ms")
        checks = sum(list(spent.values())[3:])
        print(f"  the checks are {checks / spent['everything, compared']:.1%} of reading everything")
    path = folder / "door-driver.zarr"
    filled(path, (20, 256), 200)
    opened = float(np.median([cpu(lambda: DriverStore(path).close()) for _ in range(repeats)]))
    print(f"opening for a resume, all records and the last blocks of 200 candidates compared: {opened:.3f} s (CPU)")


def digests_of(blocks: list[np.ndarray[Any, Any]]) -> None:
    """The digests of the arrays of a block."""
    for values in blocks:
        block_digest("search", "x", 0, 0, 1, values)


def main() -> None:
    """Run the parts asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=["rates", "waves"], help="rates, codecs, waves, door")
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--candidates", type=int, default=5_000, help="length of the campaign of waves")
    parser.add_argument("--folder", type=Path, default=None, help="where to write; default: a temporary folder")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        if "rates" in options.parts:
            rates(Path(folder), options.repeats)
        if "codecs" in options.parts:
            codecs(options.repeats)
        if "waves" in options.parts:
            waves(Path(folder), options.candidates)
        if "door" in options.parts:
            door(Path(folder), options.repeats)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
