"""Owns `[opening]`: how the lot is let go again."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from softclose.allowed.types import (
    MAX_COUNT,
    MAX_HORIZON_US,
    SETTINGS,
)


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class OpeningSection:
    """How the lot is let go again; without an instant, a campaign designs the closing only."""

    release_us: Annotated[float, Field(ge=0, le=MAX_HORIZON_US)] = 0.0
    """Begin of the fall of the holding pulse [µs], at model.horizon_us or later; 0: the opening is not designed."""
    brake: Annotated[int, Field(ge=0, le=20_000, strict=True)] = 300
    """Waveforms tried for a braking pulse after the fall of the best candidate; 0: it falls as it is."""
    n_switches: Annotated[int, Field(ge=10, le=MAX_COUNT, strict=True)] = 500
    """Switches of the training ensemble that the brake is designed on, all of a smaller one."""
    watch_us: Annotated[float, Field(ge=1, le=1e4)] = 200.0
    """How long the lot is watched after the fall began [µs], at 800 instants."""

    @property
    def is_designed(self) -> bool:
        """Whether the campaign designs the opening."""
        return self.release_us > 0.0
