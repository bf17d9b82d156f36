"""Small campaigns for store tests: made-up numbers with the real shapes, each a pure function of its indices."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose_store import DriverStore, Layout, create_campaign, write_chunk

CONFIG: dict[str, Any] = {"campaign": {"seed": 7, "budget": 4}, "model": {"horizon_us": 250.0}}
RUNTIME = {"host": "here", "versions": {"zarr": "3"}}


def layout(**changes: Any) -> Layout:
    """Ten switches in chunks of four: the last chunk is short."""
    sizes: dict[str, Any] = {
        "n_candidates": 4,
        "n_switches": 10,
        "chunk_switches": 4,
        "times_us": np.linspace(0.0, 250.0, 11),
        "max_impacts": 3,
        "n_pulses": 2,
    }
    return Layout(**(sizes | changes))


def population(n: int = 10) -> dict[str, NDArray[np.float64]]:
    rng = np.random.default_rng(0)
    return {name: rng.random(n) for name in "DGETKM"}


def create(path: Any, config: dict[str, Any] | None = None, durable: bool = False, **changes: Any) -> Layout:
    sizes = layout(**changes)
    create_campaign(
        path,
        layout=sizes,
        config=CONFIG if config is None else config,
        population=population(sizes.n_switches),
        runtime=RUNTIME,
        durable=durable,
    )
    return sizes


def chunk(sizes: Layout, i: int, i_chunk: int, n_switches: int) -> dict[str, NDArray[Any]]:
    """The arrays of one chunk."""
    rows = sizes.rows(i_chunk, n_switches)
    n = rows.stop - rows.start
    rng = np.random.default_rng([i, i_chunk, 5])
    arrays: dict[str, NDArray[Any]] = {}
    for spec in sizes.switch_arrays:
        shape = (n, *sizes.shape(spec)[2:])
        if spec.dtype == "bool":
            arrays[spec.name] = rng.random(shape) < 0.5
        elif spec.dtype.startswith("i"):
            arrays[spec.name] = rng.integers(0, 5, shape).astype(spec.dtype)
        else:
            arrays[spec.name] = rng.random(shape).astype(spec.dtype)
    arrays["max_contact_speed"][0] = np.nan
    arrays["first_contact"][0] = np.inf
    return arrays


def proposal(i: int, n_switches: int = 10) -> dict[str, Any]:
    return {
        "waveform": np.array([[0.0, 4.0, 10.0 + i, 150.0], [30.0, 5.0, np.inf, 80.0]]),
        "n_switches": n_switches,
        "origin": "sobol",
        "note": "größer" if i == 1 else "",
        "surrogate": {"noise": 0.1 * i, "scale": 2.0} if i % 2 else {},
    }


def record(i: int) -> dict[str, Any]:
    return {
        "failed": False,
        "failure": "",
        "g_cm_s": 30.0 - i if i != 3 else 29.5,
        "v_u_cm_s": 20.0,
        "mean_cm_s": 15.0,
        "p_nc": 0.1,
        "p_exceed": np.array([0.2]),
        "wall_propose_s": 0.5,
    }


def run_candidate(store: DriverStore, i: int, n_switches: int = 10) -> None:
    """Propose, compute what is missing, commit."""
    if store.proposal(i) is None:
        store.propose(i, proposal(i, n_switches))
    digest = store.proposal_digest(i)
    for i_chunk, done in enumerate(store.chunks_done(i)):
        if not done:
            write_chunk(store.path, i, i_chunk, chunk(store.layout, i, i_chunk, n_switches), digest)
    store.read_switch_metrics(i)
    store.commit(i, record(i))


def run(path: Any, until: int = 4) -> None:
    """Continue a campaign; candidate 2 uses 7 of the switches."""
    with DriverStore(path) as store:
        for i in range(store.n_committed, until):
            run_candidate(store, i, 7 if i == 2 else 10)
