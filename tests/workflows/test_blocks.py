"""Claims about blocks: they follow from the configuration, fit their waves, and hold about as much work each."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from softclose import Wave, load_config
from softclose_workflows.run.blocks import stage_layouts


def waves(stage: str, sizes: list[int], n_switches: int) -> list[Wave]:
    starts = [sum(sizes[:k]) for k in range(len(sizes))]
    return [
        Wave(index=k, stage=stage, start=start, size=size, n_switches=n_switches, sees=k)
        for k, (start, size) in enumerate(zip(starts, sizes, strict=True))
    ]


@pytest.mark.parametrize(
    ("n_switches", "sizes", "candidates", "switches"),
    [
        (256, [160, 80, 80], 20, 256),
        (2_000, [40, 40], 2, 2_000),
        (20_000, [8, 8], 1, 5_000),
        (1_000_000, [1], 1, 15_625),
        (60, [4, 4], 4, 60),
        (256, [20, 20, 7], 10, 256),  # a wave of one block, in two along its candidates
        (256, [40, 20, 7], 10, 256),  # where one of several waves would be one
        (256, [30, 20, 7], 10, 256),
        (256, [19, 19, 7], 19, 128),  # along its switches
        (255, [19, 19, 7], 19, 128),
        (4_000, [1, 1], 1, 2_000),
        (3_000, [1, 1], 1, 3_000),  # halves of less than a third of a block
        (256, [20], 10, 256),
    ],
)
def test_the_automatic_size_of_a_block(n_switches: int, sizes: list[int], candidates: int, switches: int) -> None:
    config = load_config("current", [f"population.n_switches={n_switches}"])
    (layout,) = stage_layouts(config, waves("search", sizes, n_switches))
    assert (layout.block_candidates, layout.block_switches) == (candidates, switches)
    assert (layout.n_candidates, layout.n_switches) == (sum(sizes), n_switches)


@pytest.mark.parametrize(
    ("settings", "switches"),
    [
        ((), 5120),
        (("amplifier.bandwidth_kHz=500.0",), 3938),
        (("model.quality_factor=20.0",), 3413),
        (("temperature.worst_of=3",), 2560),
    ],
)
def test_what_costs_more_is_cut_finer(settings: tuple[str, ...], switches: int) -> None:
    preset = "current-temperature" if "temperature" in str(settings) else "current"
    assert load_config(preset, settings).block_switches == switches


@given(
    sizes=st.lists(st.integers(1, 200), min_size=1, max_size=4) | st.integers(1, 200).map(lambda size: [size] * 3),
    last=st.integers(1, 200),
    n_switches=st.integers(1, 30_000),
    wanted=st.integers(200, 20_000),
)
def test_blocks_divide_the_waves_and_hold_no_more_than_was_asked_for(
    sizes: list[int], last: int, n_switches: int, wanted: int
) -> None:
    config = load_config("current", [f"population.n_switches={n_switches}", f"compute.block_switches={wanted}"])
    (layout,) = stage_layouts(config, waves("search", [*sizes, last], n_switches))
    assert all(size % layout.block_candidates == 0 for size in sizes)
    assert layout.block_candidates == 1 or layout.block_candidates * layout.block_switches <= wanted
    assert layout.block_switches <= min(wanted, n_switches)
    n_blocks = -(-n_switches // layout.block_switches)
    assert layout.block_switches * n_blocks - n_switches < n_blocks  # equal parts, but for one switch
    n_tasks = min(sizes) // layout.block_candidates * n_blocks
    assert n_tasks > 1 or n_switches == 1 or 3 * min(sizes) * n_switches < 2 * wanted


def test_a_block_is_cut_in_two_where_each_half_is_just_a_third_of_what_it_may_hold() -> None:
    for wanted, switches in ((3_000, 1_000), (3_001, 2_000)):
        config = load_config("current", [f"compute.block_switches={wanted}"])
        (layout,) = stage_layouts(config, waves("search", [1, 1], 2_000))
        assert layout.block_switches == switches


def test_a_stage_has_room_for_the_largest_ensemble_of_its_waves() -> None:
    """As of a finish whose ensembles grow."""
    growing = [wave for n in (500, 4_000, 2_000) for wave in waves("finish", [4], n)]
    (layout,) = stage_layouts(load_config("current"), growing)
    assert layout.n_switches == 4_000


def test_an_ensemble_whose_blocks_cannot_be_cut_gets_one_block_more() -> None:
    """13,829 is a prime above the largest inner chunk; the automatic block of 885,056 switches is as many."""
    config = load_config("current", ["population.n_switches=13829", "compute.block_switches=13829"])
    (layout,) = stage_layouts(config, waves("search", [1], 13_829))
    assert layout.block_switches == 6915
    automatic = load_config("current", ["population.n_switches=885056"])
    assert automatic.block_switches == 13_829
    (layout,) = stage_layouts(automatic, waves("search", [1], 885_056))
    assert layout.block_switches == 13_617


def test_stages_keep_their_order_and_their_own_sizes() -> None:
    config = load_config("current")
    both = [*waves("search", [20, 4], 1_000), *waves("finish", [8], 4_096)]
    search, finish = stage_layouts(config, both)
    assert (search.name, search.n_candidates, search.n_switches) == ("search", 24, 1_000)
    assert (finish.name, finish.n_candidates, finish.n_switches) == ("finish", 8, 4_096)
