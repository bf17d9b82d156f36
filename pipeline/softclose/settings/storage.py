"""Owns `[compute]` and `[store]`: how the work is cut up, what is kept of each switch."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from softclose.allowed.types import (
    MAX_SWITCHES,
    SETTINGS,
)

MAX_BLOCKS = 256
"""Blocks of one candidate at most: the number of files stays bounded, whatever the ensemble."""

AUTO_BLOCKS = 64
"""Blocks of one candidate at most where compute.block_switches is 0."""

AUTO_BLOCK_SWITCHES = 5120
"""Simulated switches per block where compute.block_switches is 0 and a trajectory is one of Eqs. 1-2: 50 to 100 ms,
which outweighs Dask's millisecond. Fewer where the device model says that one costs more."""

STORED_S = 4e-6
"""What storing a trajectory takes, about [s]."""


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class ComputeSection:
    """How the work is cut up. Block boundaries are part of the store's identity."""

    block_switches: Annotated[int, Field(ge=0, le=MAX_SWITCHES, strict=True)] = 0
    """Simulated switches per block (one Dask task), several candidates' where ensembles are small; 0 chooses: 5,120,
    fewer where a trajectory costs more than one of Eqs. 1-2, more where that would cut a candidate into more than 64
    blocks."""
    rtol: Annotated[float, Field(ge=1e-13, le=1e-6)] = 1e-9
    """Relative tolerance of the integrator; above 1e-6 a step may pass over a contact."""
    method: Literal["taylor", "rk"] = "taylor"
    """Integrator."""


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class StoreSection:
    """What the store keeps of each switch."""

    n_times: Annotated[int, Field(ge=2, le=100_001, strict=True)] = 1001
    """Points of the uniform time grid of x and v, from 0 to the horizon."""
    max_impacts: Annotated[int, Field(ge=1, le=4096, strict=True)] = 64
    """Impact events kept per switch; n_impacts counts all of them."""
    durable: bool = False
    """Sync every commit to the disk, against loss of power."""
    trials: bool = True
    """Whether the motion under each trial of a brake, and in each actuation by which a trim learns, is kept, too."""
