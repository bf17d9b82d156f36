"""Owns the protocol of device models (switches × waveform -> responses) and the registry of those installed.

Nothing outside a model may assume one degree of freedom or a cheap simulator. A user's own model, a finite-element code
for instance, is an entry point of group `softclose.models` and is named by `model.name` in a campaign.
"""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike

from softclose.naming import unknown_name
from softclose.waveform import Waveform

if TYPE_CHECKING:  # the compiler takes half a second to import, and reading a configuration needs none of it
    from softclose.ensemble import Responses

SINGLE_MODE = "single-mode"
"""The model of Eqs. 1-2, `softclose.simulate`."""


class ModelError(ValueError):
    """A device model that is not installed."""


class DeviceModel(Protocol):
    """What a campaign calls: `softclose.simulate` is one. Deterministic, and each row independent of the others."""

    def __call__(
        self,
        switches: ArrayLike,
        waveform: Waveform,
        *,
        horizon_us: float,
        restitution: float,
        plate_area_um2: float,
        rtol: float,
        method: Any,
        max_volts: float,
        max_impacts: int = 0,
        times_us: ArrayLike | None = None,
        threads: int = 1,
        dtype: type[np.float64] | type[np.float32] = np.float64,
    ) -> Responses:
        """switches: (n, 4) float64 D [µm], G [µm], K [N/m], M [µg]. `rtol` and `method` may mean nothing to a model."""
        ...


def model_names() -> tuple[str, ...]:
    """The built-in model and those installed."""
    return (SINGLE_MODE, *sorted(e.name for e in entry_points(group="softclose.models")))


def check_model_name(name: str) -> None:
    """Raise ModelError, naming the nearest known model, where there is none of that name. Imports no model."""
    if name not in model_names():
        raise ModelError(unknown_name("device model", name, model_names(), "model.name"))


def load_model(name: str) -> DeviceModel:
    """The device model of that name. Raises ModelError."""
    if name == SINGLE_MODE:
        from softclose.ensemble import simulate

        return simulate
    check_model_name(name)
    entry = next(e for e in entry_points(group="softclose.models") if e.name == name)
    return cast(DeviceModel, entry.load())
