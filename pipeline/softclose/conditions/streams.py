"""Owns the streams of random numbers, by name: which ensemble of switches, and which of its coordinates.

A switch's coordinates are keyed by (seed, stream, index), the stream being that of its ensemble plus that of the
coordinate. Two sums that are equal would draw the same numbers for two things: that is an error at import.
"""

from __future__ import annotations

import enum
import itertools

import numpy as np


class StreamError(ValueError):
    """Two things that would draw the same random numbers."""


@enum.unique
class Ensemble(enum.IntEnum):
    """Who draws switches."""

    TRAINING = 0
    """A campaign, for its candidates."""
    CERTIFICATE = 1
    """A certificate: no search ever sees them."""
    TAIL = 2
    """Brute force of rare failures."""
    DEVICES = 7_400_000
    """Lots that a few measured devices may have come from."""
    PRIOR = 7_650_000
    """A search's prior, for its few switches."""
    CONTROL = 7_920_000
    """A search's prior, for the many switches of a control variate."""


@enum.unique
class Stream(enum.IntEnum):
    """What is drawn of a switch."""

    LOT = 0
    """Its own four variables."""
    MEASUREMENT = 7_100_000
    """Errors of what is measured on it."""
    DRIVE = 7_200_000
    """Gain and clock of its drive."""
    TEMPERATURE = 7_300_000
    """Its temperature."""
    TIMING = 7_500_000
    """Errors of its timed contacts."""
    MODEL_ERROR = 7_600_000
    """What the model is wrong about."""


@enum.unique
class Draw(enum.IntEnum):
    """What else is drawn, by analyses: no switches, so keyed apart from them."""

    TOLERANCE = 8_000_001
    """Errors of each of a number of generators."""
    SENSITIVITY = 8_000_002
    """Scramblings of the replicates."""


BRAKE = 19
"""Of a brake's search, behind the seed."""


def key(seed: int, draw: Draw, index: int) -> np.random.SeedSequence:
    """Entropy of one draw of an analysis, keyed by (seed, what, index)."""
    return np.random.SeedSequence(int(seed), spawn_key=(int(draw), int(index)))


def check(ensembles: type[enum.IntEnum], streams: type[enum.IntEnum]) -> None:
    """Raise StreamError where two pairs of ensemble and coordinate have the same sum."""
    seen: dict[int, tuple[str, str]] = {}
    for ensemble, stream in itertools.product(ensembles, streams):
        pair, key = (ensemble.name, stream.name), int(ensemble) + int(stream)
        if key in seen:
            raise StreamError(f"streams {seen[key]} and {pair} are both {key}: choose another number for one of them")
        seen[key] = pair


check(Ensemble, Stream)
