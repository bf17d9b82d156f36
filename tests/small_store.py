"""Small campaigns for store tests: made-up numbers with the real shapes, each a pure function of its indices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose_store import (
    DriverStore,
    Layout,
    Recompute,
    StageLayout,
    create_campaign,
    proposals_digest,
    write_block,
)

CONFIG: dict[str, Any] = {"campaign": {"seed": 7, "budget": 8}, "model": {"horizon_us": 250.0}}
RUNTIME = {"host": "here", "versions": {"zarr": "3"}}
ALGORITHM = "waves-1"

SEARCH = StageLayout(name="search", n_candidates=5, n_switches=10, block_candidates=2, block_switches=4)
FINISH = StageLayout(name="finish", n_candidates=3, n_switches=12, block_candidates=1, block_switches=6)
EXTENSION = StageLayout(name="extend1", n_candidates=2, n_switches=12, block_candidates=1, block_switches=6)
"""What may be added after the end."""
EXTENSION_WAVES = {8: 2}
WAVES = {0: 4, 4: 1, 5: 2, 7: 1}
"""First candidate -> size, of every wave of the small campaign."""
USED = {4: 7}
"""First candidate of a wave -> its switches, where it uses less than the stage's ensemble."""
FAILED = frozenset({3})
"""Candidates that fail: their rows are NaN."""


def layout(stages: Sequence[StageLayout] = (SEARCH, FINISH), **changes: Any) -> Layout:
    """Two stages: five candidates of ten switches in blocks of 2 x 4, three of twelve in blocks of 1 x 6."""
    sizes: dict[str, Any] = {
        "stages": tuple(stages),
        "times_us": np.linspace(0.0, 250.0, 11),
        "max_impacts": 3,
        "n_pulses": 2,
    }
    return Layout(**(sizes | changes))


def population(n: int = 12) -> dict[str, NDArray[np.float64]]:
    rng = np.random.default_rng(0)
    return {name: rng.random(n) for name in "DGETKM"}


def create(
    path: Any,
    sizes: Layout | None = None,
    config: dict[str, Any] | None = None,
    algorithm: str = ALGORITHM,
    **options: Any,
) -> Layout:
    sizes = layout() if sizes is None else sizes
    create_campaign(
        path,
        layout=sizes,
        config=CONFIG if config is None else config,
        population=population(sizes.n_switches),
        algorithm=algorithm,
        runtime=RUNTIME,
        **options,
    )
    return sizes


def block(sizes: Layout, stage: str, i: int, j: int, n_switches: int | None = None) -> dict[str, NDArray[Any]]:
    """The arrays of one block."""
    n_candidates, n = sizes.stage(stage).block_shape(i, j)
    if n_switches is not None:
        n = min(n, n_switches - sizes.stage(stage).switches(j).start)
    rng = np.random.default_rng([len(stage), i, j, 5])
    arrays: dict[str, NDArray[Any]] = {
        name: rng.random((n_candidates, n, *rest)).astype(dtype) for name, (rest, dtype) in sizes.block_arrays.items()
    }
    response = arrays["response"]
    response[..., 3] = rng.integers(0, 5, response.shape[:2])
    response[..., 6] = response[..., 6] < 0.5
    response[..., 7] = 0
    response[:, 0, 0] = np.nan
    response[:, 0, 1] = np.inf
    first = sizes.first(stage) + sizes.stage(stage).candidates(i).start
    for k in range(n_candidates):
        if first + k in FAILED:
            for values in arrays.values():
                values[k] = np.nan
            response[k, :, 6] = 0
            response[k, :, 7] = -1
    return arrays


def proposal(i: int, n_switches: int = 10) -> dict[str, Any]:
    return {
        "waveform": np.array([[0.0, 4.0, 10.0 + i, 150.0], [30.0, 5.0, np.inf, 80.0]][: 1 + (i != 2)]),
        "n_switches": n_switches,
        "origin": "sobol",
        "note": "größer" if i == 1 else "",
        "surrogate": {"noise": 0.1 * i, "scale": 2.0} if i % 2 else {},
    }


def record(i: int) -> dict[str, Any]:
    if i in FAILED:
        return {"failed": True, "failure": "the device model says no"}
    return {
        "failed": False,
        "failure": "",
        "feasible": True,
        "n_failed_switches": 0,
        "g_cm_s": 30.0 - i if i != 4 else 29.5,
        "rank_cm_s": 30.0 - i if i != 4 else 29.5,
        "v_u_cm_s": 20.0,
        "mean_cm_s": 15.0,
        "p_nc": 0.1,
        "p_exceed": np.array([0.2]),
    }


def wave_at(sizes: Layout, start: int) -> tuple[str, int, int]:
    """(stage, size, switches) of the wave that begins at a candidate."""
    stage, _ = sizes.stage_of(start)
    return stage.name, {**EXTENSION_WAVES, **WAVES}[start], USED.get(start, stage.n_switches)


def proposals(sizes: Layout, start: int) -> list[dict[str, Any]]:
    _, size, n = wave_at(sizes, start)
    return [proposal(i, n) for i in range(start, start + size)]


def block_digests(sizes: Layout, start: int, blocks: Sequence[tuple[int, int]]) -> list[int]:
    """The proposals' digest of each block of a wave."""
    name, _, n = wave_at(sizes, start)
    stage, first = sizes.stage(name), sizes.first(name)
    digests = []
    for i, _ in blocks:
        rows = stage.candidates(i)
        waveforms = [proposal(first + k)["waveform"] for k in range(rows.start, rows.stop)]
        digests.append(proposals_digest(waveforms, n, first + rows.start))
    return digests


def write_wave(store: DriverStore, start: int, check: bool = True) -> dict[tuple[int, int], NDArray[np.uint64]]:
    """Compute the blocks of a wave that are missing; the markers of all."""
    sizes = store.layout
    name, size, n = wave_at(sizes, start)
    blocks = sizes.wave_blocks(start, size, n)
    expected = block_digests(sizes, start, blocks)
    done = store.blocks_done(name, blocks, expected, check=check)
    for (i, j), digest, is_done in zip(blocks, expected, done, strict=True):
        if not is_done:
            write_block(store.path, name, i, j, block(sizes, name, i, j, n), digest)
    return store.markers(name, blocks)


def rows(sizes: Layout, start: int) -> list[Mapping[str, Any]]:
    """The rows of a wave."""
    return [p | record(i) | {"wall_propose_s": 0.5} for i, p in enumerate(proposals(sizes, start), start)]


def run_wave(store: DriverStore) -> None:
    """The next wave: compute what is missing, commit."""
    start = store.n_committed
    store.commit(rows(store.layout, start), write_wave(store, start))


def run(path: Any, until: int = 8) -> None:
    """Continue a campaign to `until` committed candidates: the end of a wave."""
    with DriverStore(path) as store:
        while store.n_committed < until:
            run_wave(store)


def recompute() -> Recompute:
    """How all of it is computed again."""

    def switches(sizes: Layout, stage: str, i: int) -> int:
        start = sizes.first(stage) + sizes.stage(stage).candidates(i).start
        return USED.get(start, sizes.stage(stage).n_switches)

    return Recompute(
        population=lambda config: population(),
        times_us=lambda config: layout().times_us,
        waves=lambda config: [*WAVES.values(), *config["campaign"].get("extensions", [])],
        proposals=lambda store, start, size: proposals(store.layout, start),
        block=lambda store, stage, i, j: block(store.layout, stage, i, j, switches(store.layout, stage, i)),
        record=lambda store, i: record(i),
    )
