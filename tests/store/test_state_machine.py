"""Claims about any order of what can happen to a store, against a model in memory (hypothesis)."""

from __future__ import annotations

import random
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

import small_store
from examples import examples
from small_store import ALGORITHM, CONFIG, EXTENSION, create, layout, recompute, run_wave, write_wave
from softclose_store import (
    DamageError,
    DriverStore,
    GroupArray,
    StoreError,
    extend_campaign,
    list_groups,
    open_campaign,
    read_group,
    remove_orphans,
    repair,
    verify,
    write_block,
    write_group,
)
from softclose_store.write.block import forget_writer
from stores import damage, files_of

GROUP = "certification/one"
KINDS = ("flip", "truncate", "append", "delete")


def certify(path: Path) -> None:
    arrays = {"speed": GroupArray(dims=("switch",), values=np.arange(9.0), unit="cm/s")}
    write_group(path, GROUP, arrays, {"n": 9}, replace=True)


def mended(path: Path) -> Any:
    def group(where: Any, name: str, attributes: Any) -> str:
        certify(Path(where))
        return ""

    return replace(recompute(), group=group)


class Store(RuleBasedStateMachine):
    """One campaign's life: created, driven, killed, damaged, repaired, certified, extended, read all the while."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp())
        self.path = self.folder / "a.zarr"
        self.driver: DriverStore | None = None
        self.committed = 0
        self.extended = False
        self.certified = False
        self.damaged = False

    def teardown(self) -> None:
        if self.driver is not None:
            self.driver.close()
        forget_writer(self.path)
        shutil.rmtree(self.folder)

    @property
    def budget(self) -> int:
        return 10 if self.extended else 8

    @initialize(durable=st.booleans())
    def creation(self, durable: bool) -> None:
        create(self.path, durable=durable)

    @precondition(lambda self: self.driver is None and not self.damaged)
    @rule()
    def opened_by_a_driver(self) -> None:
        self.driver = DriverStore(self.path)
        assert self.driver.n_committed == self.committed

    @precondition(lambda self: self.driver is not None)
    @rule()
    def killed(self) -> None:
        """What a driver knows is gone; the kernel gives its lock back."""
        assert self.driver is not None
        self.driver.close()
        self.driver = None
        forget_writer(self.path)

    @precondition(lambda self: self.driver is not None and self.committed < self.budget)
    @rule(data=st.data())
    def some_blocks_of_the_next_wave(self, data: st.DataObject) -> None:
        assert self.driver is not None
        sizes = self.driver.layout
        name, size, n = small_store.wave_at(sizes, self.committed)
        blocks = sizes.wave_blocks(self.committed, size, n)
        expected = small_store.block_digests(sizes, self.committed, blocks)
        for k in data.draw(st.sets(st.integers(0, len(blocks) - 1), max_size=3)):
            i, j = blocks[k]
            write_block(self.path, name, i, j, small_store.block(sizes, name, i, j, n), expected[k])
            assert self.driver.blocks_done(name, [blocks[k]], [expected[k]]) == [True]

    @precondition(lambda self: self.driver is not None and self.committed < self.budget)
    @rule()
    def a_wave_is_committed(self) -> None:
        assert self.driver is not None
        run_wave(self.driver)
        self.committed = self.driver.n_committed

    @precondition(lambda self: self.driver is not None and self.committed < self.budget)
    @rule()
    def all_blocks_and_no_commit(self) -> None:
        assert self.driver is not None
        write_wave(self.driver, self.committed)

    @precondition(lambda self: self.committed > 0 and not self.damaged)
    @rule()
    def certification(self) -> None:
        certify(self.path)
        self.certified = True

    @precondition(lambda self: self.driver is None and not self.damaged and not self.extended)
    @rule()
    def extension(self) -> None:
        section = {**CONFIG["campaign"], "extensions": [2]}
        wanted = {
            "layout": layout((*layout().stages, EXTENSION)),
            "config": {**CONFIG, "campaign": section},
            "algorithm": ALGORITHM,
            "note": {},
        }
        if self.committed < self.budget:
            with pytest.raises(StoreError, match="can be extended once it is"):
                extend_campaign(self.path, **wanted)
            return
        extend_campaign(self.path, **wanted)
        self.extended = True

    @precondition(lambda self: self.driver is None and self.committed > 0)
    @rule(kind=st.sampled_from(KINDS), seed=st.integers(0, 2**32 - 1))
    def damage(self, kind: str, seed: int) -> None:
        rng = random.Random(seed)
        files = [f for f in files_of(self.path) if f.stat().st_size and "runtime" not in f.parts]
        damage(rng.choice(files), kind, rng)
        self.damaged = True

    @precondition(lambda self: self.damaged)
    @rule()
    def repaired(self) -> None:
        try:
            done = repair(self.path, mended(self.path))
        except DamageError as e:
            if "both damaged" not in str(e):
                raise
            shutil.rmtree(self.path)  # the message's advice: nothing says any more what it was
            create(self.path)
            self.committed, self.extended, self.certified, self.damaged = 0, False, False, False
            return
        if not done.ok:  # both copies of a group's metadata: nothing says any more what it held
            assert all(GROUP in what for what in done.failed), done.failed
            shutil.rmtree(self.path / GROUP)
            self.certified = False
        self.damaged = False

    @precondition(lambda self: not self.damaged)
    @rule()
    def read_while_it_grows(self) -> None:
        with xr.open_zarr(self.path, group="candidates") as ds:
            assert ds.sizes["candidate"] == self.committed
            assert ds["records"].sel(field="g_cm_s").isnull().sum() == (self.committed > 3)
        campaign = open_campaign(self.path)
        assert campaign.committed == self.committed
        for i in range(self.committed):
            assert campaign.trajectories(i).x.shape[1] == 11

    @precondition(lambda self: self.driver is None and not self.damaged)
    @rule()
    def left_behind_is_removed(self) -> None:
        remove_orphans(self.path)

    @invariant()
    def what_is_said_of_it_is_true(self) -> None:
        if not self.path.exists() or self.damaged:
            return
        assert verify(self.path).ok, verify(self.path).problems
        campaign = open_campaign(self.path)
        assert (campaign.committed, campaign.budget) == (self.committed, self.budget)
        assert (GROUP in list_groups(self.path)) == self.certified
        if self.certified:
            assert read_group(self.path, GROUP).arrays["speed"].tolist() == list(range(9))


Store.TestCase.settings = settings(
    max_examples=examples(15),
    stateful_step_count=16,
    deadline=None,
    suppress_health_check=list(HealthCheck),
    phases=(Phase.generate,),
)
TestStore = Store.TestCase
