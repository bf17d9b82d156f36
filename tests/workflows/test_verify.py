"""Claims about `softclose verify`: what it replays is equal, what is damaged is found, what it repairs is proved."""

from __future__ import annotations

import json
import random
import shutil
from pathlib import Path

import pytest

from campaigns import softclose
from examples import in_turn
from softclose_store import open_campaign
from stores import differences


def test_replayed_blocks_and_waves_are_equal_bit_for_bit(reference_store: Path) -> None:
    done = softclose("verify", str(reference_store), "--replay", "30", "--json")
    told = json.loads(done.stdout)
    assert done.returncode == 0, done.stdout
    campaign = open_campaign(reference_store)
    assert len({tuple(block) for block in told["replayed_blocks"]}) == 3 * campaign.committed
    assert told["replayed_waves"] == list(range(campaign.n_waves))
    assert told["differing"] == []


@pytest.mark.parametrize("seed", in_turn(range(3), 3))
def test_damage_is_found_and_repaired_to_the_same_bits(seed: int, tmp_path: Path, reference_store: Path) -> None:
    store = tmp_path / "a.zarr"
    shutil.copytree(reference_store, store)
    rng = random.Random(seed)
    files = sorted(f for f in store.rglob("c.*") if f.is_file() and "wall_" not in str(f))
    for file in rng.sample(files, 3):
        content = bytearray(file.read_bytes())
        match rng.choice(("flip", "truncate", "delete")):
            case "flip":
                content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
                file.write_bytes(content)
            case "truncate":
                file.write_bytes(content[: rng.randrange(len(content))])
            case "delete":
                file.unlink()
    assert softclose("verify", str(store)).returncode == 1
    mended = softclose("verify", str(store), "--repair")
    assert mended.returncode == 0, mended.stdout + mended.stderr
    assert differences(reference_store, store) == []
