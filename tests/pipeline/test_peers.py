"""Claims about the scoreboard of other people's optimisers: peers hear what their points are worth."""

from __future__ import annotations

import json
import math
import random
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmark_files import BENCHMARKS, benchmark
from softclose.evaluate import draw
from softclose.propose.protocol import Problem
from softclose.settings import CampaignConfig, load_config
from softclose.waveform.pulses import WaveformError


@pytest.fixture(scope="module")
def peers() -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        yield benchmark("peers")
    for name in ("peers", "prior"):
        del sys.modules[name]


@pytest.fixture(scope="module")
def peer() -> Any:
    return benchmark("peer")


N = 12
"""Candidates of a run."""


@pytest.fixture(scope="module")
def config() -> CampaignConfig:
    return load_config(
        "current",
        [
            "waveform.space=three-pulse-full",
            f"campaign.budget={N}",
            "population.n_switches=30",
            "population.sampling=monte-carlo",
        ],
    )


def drawn_by_random(seed: int, dim: int) -> list[list[float]]:
    draws = random.Random(seed)
    return [[draws.random() for _ in range(dim)] for _ in range(N)]


def worth(peers: Any, config: CampaignConfig, points: list[list[float]], *, raw: bool) -> list[float]:
    """What the points are worth, one after the other, without a pipe."""
    space = Problem(config).space
    lot = draw(config, 30, seed=config.campaign.seed, sampling=config.population.sampling)
    values = []
    for point in points:
        w = peers.raw_waveform(point, space.n_pulses, config) if raw else space.waveform(point)
        try:
            w.check(config.waveform.max_volts, config.model.horizon_us, config.waveform.least_rise_us)
            values.append(peers.value(config, lot, w)[0])
        except WaveformError:
            values.append(peers.NEVER_CM_S)
    return values


@pytest.mark.parametrize("raw", [False, True], ids=["ours", "raw"])
def test_the_best_of_a_peer_is_the_best_of_its_points(peers: Any, config: CampaignConfig, raw: bool) -> None:
    dim = peers.raw_dimensions(3) if raw else Problem(config).space.dim
    values = worth(peers, config, drawn_by_random(config.campaign.seed, dim), raw=raw)
    found = peers.one("random", config, raw=raw, budget=N, python=Path(sys.executable), n_fresh=200)
    assert found["training"] == round(min(values), 3)
    assert found["trajectories"] == 30 * N
    assert math.isfinite(found["certified"])


TALK = """\
#!{python}
import json, sys
asked, heard = sys.argv[2:], []
for point in {points}:
    print(json.dumps({{"point": point, "s": 0.25}}), flush=True)
    heard.append(json.loads(sys.stdin.readline()))
with open("{heard}", "w") as file:
    json.dump([asked, heard], file)
"""


def test_a_peer_hears_what_its_points_are_worth(peers: Any, config: CampaignConfig, tmp_path: Path) -> None:
    dim = Problem(config).space.dim
    points = drawn_by_random(7, dim)
    heard, python = tmp_path / "heard.json", tmp_path / "python"
    python.write_text(TALK.format(python=sys.executable, points=points, heard=heard))
    python.chmod(0o755)
    found = peers.one("cma", config, raw=False, budget=N, python=python, n_fresh=200)
    values = worth(peers, config, points, raw=False)
    assert json.loads(heard.read_text()) == [["cma", str(dim), str(config.campaign.seed), str(N)], values]
    assert found["propose_ms"] == 250.0


def test_a_peer_that_ends_early_has_no_row(peers: Any, config: CampaignConfig, tmp_path: Path) -> None:
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\nexit 3\n")
    python.chmod(0o755)
    with pytest.raises(RuntimeError, match=f"cma ended after 0 of {N} candidates"):
        peers.one("cma", config, raw=False, budget=N, python=python, n_fresh=200)


def test_every_peer_has_a_search_and_packages(peers: Any, peer: Any) -> None:
    assert set(peers.PACKAGES) == set(peer.PEERS)


@pytest.mark.parametrize("name", ["random", "cma", pytest.param("skopt", marks=pytest.mark.long)])
def test_a_search_stays_within_the_cube_and_is_a_function_of_its_seed(peer: Any, name: str) -> None:
    """Of the peers that the tests' environment has; 25 points: skopt's process leads from the 21st."""

    def points(seed: int) -> list[list[float]]:
        search = peer.PEERS[name](4, seed, 25)
        asked = [next(search)]
        for _ in range(24):
            asked.append(search.send(sum((x - 0.3) ** 2 for x in asked[-1])))
        return asked

    first = points(1)
    assert np.all((np.array(first) >= 0.0) & (np.array(first) <= 1.0))
    assert first == points(1)
    assert first != points(2)


def test_rows_are_in_the_order_of_their_medians(peers: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = [("b", 20.0, 0.04), ("b", 30.0, 0.04), ("a", 21.0, 0.04), ("a", 22.0, 0.04), ("a", 19.0, 1.0)]
    lines = [
        {"space": "s", "peer": p, "coordinates": "ours", "budget": 9, "trajectories": m * 1e6}
        | {"certified": g, "training": g - 1.0, "propose_ms": 4.0}
        for p, g, m in runs
    ]
    path = tmp_path / "peers.jsonl"
    path.write_text("\n".join(map(json.dumps, lines)))
    peers.table(path)
    assert capsys.readouterr().out.splitlines()[2:] == [
        "| s | a | ours | 9 | 1.0 | 19.00 | 18.00 | 4 |",
        "| s | a | ours | 9 | 0.04 | 21.00 22.00 | 20.00 21.00 | 4 |",
        "| s | b | ours | 9 | 0.04 | 20.00 30.00 | 19.00 29.00 | 4 |",
    ]
