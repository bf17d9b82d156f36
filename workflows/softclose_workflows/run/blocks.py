"""Owns how a campaign is cut into blocks, the unit of Dask work and of storage: some candidates × some switches.

Everything here follows from the configuration alone, never from the number of workers.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from softclose.plugins import MEASURED
from softclose.propose.plan import engine_of
from softclose.propose.protocol import Wave
from softclose.settings import CampaignConfig
from softclose_store import MIN_INNER, StageLayout, largest_inner

SMALLEST = 3
"""A wave of one block is cut in two where each half is still a third of what a block may hold."""


def stage_layouts(config: CampaignConfig, waves: Sequence[Wave]) -> tuple[StageLayout, ...]:
    """The stages of a campaign in the order in which they run, each cut into blocks.

    A block holds about `compute.block_switches` simulated switches: several candidates where ensembles are small, a
    part of one candidate where they are large. A wave that would be one block is cut in two, along its candidates or,
    where their number does not divide, along its switches, unless the halves were too small to be worth a task: but
    for measured devices, of which one candidate is told whole. No block straddles two waves, so that no chunk has two
    writers.
    """
    stages = []
    for name in dict.fromkeys(wave.stage for wave in waves):
        own = [wave for wave in waves if wave.stage == name]
        n_switches = max(wave.n_switches for wave in own)
        sizes, wanted = [wave.size for wave in own], config.block_switches
        usual = sizes[:-1] or sizes  # the last wave takes what remains
        candidates = _block_candidates(usual, n_switches, wanted)
        switches = _block_switches(n_switches, wanted)
        is_one = min(usual) == candidates and switches == n_switches
        if is_one and SMALLEST * candidates * switches >= 2 * wanted and config.model.name != MEASURED:
            if candidates % 2 == 0:
                candidates //= 2
            else:
                switches = _block_switches(n_switches, math.ceil(n_switches / 2))
        stages.append(
            StageLayout(
                name=name,
                n_candidates=sum(sizes),
                n_switches=n_switches,
                block_candidates=candidates,
                block_switches=switches,
                engine=engine_of(config, name),
            )
        )
    return tuple(stages)


def _block_switches(n_switches: int, wanted: int) -> int:
    """Equal parts of the ensemble, none larger than wanted: the fewest that the store can cut into chunks.

    A prime above the largest chunk cannot be cut; one part more has another size.
    """
    parts = itertools.count(math.ceil(n_switches / wanted))
    sizes = (math.ceil(n_switches / n) for n in parts)
    return next(size for size in sizes if largest_inner(size) >= min(size, MIN_INNER))


def _block_candidates(sizes: Sequence[int], n_switches: int, wanted: int) -> int:
    """The most candidates that fit a block and divide waves of these sizes."""
    common = math.gcd(*sizes)
    fitting = max(1, wanted // n_switches)
    return max(d for d in range(1, min(common, fitting) + 1) if common % d == 0)
