"""Owns `[prior]`: the cheap model of the same lot that the Gaussian process starts from."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from softclose.allowed.types import MAX_COUNT, SETTINGS, SwitchCount

Included = Literal["losses", "amplifier", "temperature", "trim"]
"""What of a campaign's model and conditions a prior may include."""

NO_PRIOR = "none"
"""Name of no model: the process starts from nothing."""


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class PriorSection:
    """A cheap model of the same lot, on few switches: the process learns only what the campaign's own evaluation adds.

    Basins are found on it before the first candidate, by descents as those of `[explore]`.
    """

    model: Annotated[str, Field(min_length=1)] = "single-mode"
    """single-mode, none (the process starts from nothing), or an installed entry point of group softclose.models."""
    includes: tuple[Included, ...] = ("losses", "amplifier", "temperature", "trim")
    """What of the campaign's model and conditions the prior includes, where the campaign has it; less is cheaper."""
    n_switches: SwitchCount = 256
    """Switches of the prior, Sobol points of the lot."""
    n_exploring: SwitchCount = 128
    """The first of them, on which the descents find the basins."""
    budget: Annotated[int, Field(ge=1, le=MAX_COUNT, strict=True)] = 3840
    """Waveforms that the descents try on the prior."""
    n_descents: Annotated[int, Field(ge=1, le=64, strict=True)] = 6
    """Descents begun on the prior."""
    rounds: Annotated[int, Field(ge=1, le=16, strict=True)] = 2
    """Rounds of equal budgets; after each the better half of the descents goes on."""
    polish: Annotated[int, Field(ge=0, le=MAX_COUNT, strict=True)] = 408
    """Waveforms that are tried on all of the prior's switches: eight basins again, then steps of the best of them."""
    looks: Annotated[int, Field(ge=4, le=100_000, strict=True)] = 60
    """Waveforms that are tried on the prior for each candidate that the process proposes."""
    control: Annotated[int, Field(ge=0, le=MAX_COUNT, strict=True)] = 0
    """Further switches on which the prior tells how a costly simulator's few differ from the lot (control variate):
    thousands, where every switch of the campaign counts; 0: its figures are those of its own switches alone."""

    @property
    def is_there(self) -> bool:
        """Whether there is a prior."""
        return self.model != NO_PRIOR
