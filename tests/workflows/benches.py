"""Owns what tests of benches share: a lot that stands for devices, what a vibrometer says, and faults on the way."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from softclose import Waveform, load_population, simulate
from softclose.metrics.objective import CM_S
from softclose_store import faults
from softclose_workflows.api import Bench

LOT = load_population("current").sample(100, seed=99)
DEVICES, FRESH = LOT[:20], LOT[20:]
SETTINGS = ("prior.model=none", "optimiser.n_initial=4", "optimiser.n_candidates=64")


STEPS = [name for name in faults.POINTS if name != "inside-creation"]


def measure(waveform: Waveform, devices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What a vibrometer would say: cm/s, and whether each is closed."""
    response = simulate(devices, waveform)
    return response.max_contact_speed * CM_S, response.closed


def begin(path: Path, budget: int = 7) -> Bench:
    return Bench(path, "current", devices=20, budget=budget, settings=SETTINGS)


def content(store: Path) -> dict[str, bytes]:
    """Every file of a store, but the lock and what says who runs it."""
    kept = (p for p in store.rglob("*") if p.is_file() and p.name != "driver.lock")
    return {str(p.relative_to(store)): p.read_bytes() for p in kept}


def cut_at(monkeypatch: pytest.MonkeyPatch, name: str, passage: int, error: BaseException) -> None:
    """Let the durability step `name` fail at its n-th passage, once."""
    passed: Counter[str] = Counter()

    def point(here: str) -> None:
        passed[here] += 1
        if here == name and passed[here] == passage:
            raise error

    monkeypatch.setattr(faults, "point", point)
    monkeypatch.setenv(faults.VARIABLE, "by-hand")  # chunks are written in two parts only where a fault is asked for


def finish(bench: Bench, n: int = 100) -> None:
    while not bench.finished and n:
        suggestion = bench.ask()
        bench.tell(suggestion.candidate, *measure(suggestion.waveform, DEVICES))
        n -= 1


class Interrupt(Exception):
    """Stands for Ctrl-C, which pytest would heed."""
