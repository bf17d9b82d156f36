"""Owns `[campaign]` and `[population]`: what is run, how long, on which switches."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator
from pydantic.dataclasses import dataclass

from softclose.allowed.types import (
    MAX_COUNT,
    MOST_IN_A_WAVE,
    SETTINGS,
    SwitchCount,
)


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class CampaignSection:
    """What is run, and how long."""

    name: str = "campaign"
    """A title for tables and reports."""
    seed: Annotated[int, Field(ge=0, lt=2**63, strict=True)] = 1
    """Key of every random number: the ensemble and the proposals."""
    budget: Annotated[int, Field(ge=0, le=MAX_COUNT, strict=True)] = 150
    """Candidates of the search, `waveform.initial` included; 0 leaves it out."""
    extensions: tuple[int | tuple[int, ...], ...] = ()
    """What was added after the campaign was finished, in turn: a number of candidates (`softclose resume --budget`
    writes it), or earlier candidates to compute again (`--retry-failed`)."""
    wave: Annotated[int, Field(ge=1, le=MOST_IN_A_WAVE, strict=True)] = 1
    """Candidates proposed together by an engine that proposes one at a time."""
    lag: Annotated[int, Field(ge=1, le=64, strict=True)] = 1
    """Waves of the search in flight at once: wave w waits for wave w - lag and sees nothing newer."""

    @field_validator("extensions", mode="before")
    @classmethod
    def _each_extension(cls, value: Any) -> Any:
        for place, what in enumerate(value if isinstance(value, list | tuple) else ()):
            again = isinstance(what, list | tuple)
            low, high = (0, MAX_COUNT - 1) if again else (1, MAX_COUNT)
            if not what or not all(type(v) is int and low <= v <= high for v in (what if again else (what,))):
                raise ValueError(
                    f"campaign.extensions.{place} is {what!r}; it must be a number from 1 to {MAX_COUNT}, or a "
                    "list of earlier candidates to compute again"
                )
        return value


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class PopulationSection:
    """Which switches."""

    name: Annotated[str, Field(min_length=1)] = "current"
    """A shipped population, or the path of a population TOML."""
    n_switches: SwitchCount = 2000
    """Switches in the training ensemble of each candidate."""
    sampling: Literal["monte-carlo", "sobol", "replicated"] = "replicated"
    """replicated: 16 independent scramblings of a Sobol sequence, which rank candidates with less noise and have
    intervals; monte-carlo: independent draws, as published; sobol: one scrambling, which has no intervals."""


def extension_size(extension: int | tuple[int, ...]) -> int:
    """Candidates of an extension."""
    return extension if isinstance(extension, int) else len(extension)
