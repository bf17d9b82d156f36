"""Claims about a loss of power, after any step of a campaign, on a file system that keeps only what was synced."""

from __future__ import annotations

import random
from collections import Counter
from pathlib import Path

import pytest

from lose_power import Recorded, losses, record, survive
from power_loss import Disk
from stores import differences

LONG, SHORT = 41, 397
"""Steps between two losses, in `make long` and in `make test`; `make power-loss` tries all."""


@pytest.fixture(scope="module", params=[True, False], ids=["durable", "not durable"])
def recorded(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("power") / "disk", durable=request.param)


def test_the_recorded_disk_is_the_real_one(recorded: Recorded, tmp_path: Path) -> None:
    disk = Disk()
    for step in recorded.recorder.steps:
        disk.do(step)
    disk.sync_all()
    disk.lose_power(tmp_path, "forgets", random.Random(0))
    assert differences(tmp_path / "a.zarr", recorded.final) == []


@pytest.mark.parametrize("every", [pytest.param(LONG, marks=pytest.mark.long), SHORT])
@pytest.mark.slow
def test_what_is_committed_durably_survives_and_anything_else_is_made_again(
    every: int, recorded: Recorded, tmp_path: Path
) -> None:
    told = Counter(survive(recorded, *loss) for loss in losses(recorded, tmp_path, every))
    assert (told["repaired"] > 0) is not recorded.durable
    assert told["intact"] > (5 if every == LONG else 0)
