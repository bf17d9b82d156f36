"""Owns the protocol of device models (switches × waveform -> responses).

Nothing outside a model may assume one degree of freedom or a cheap simulator. A user's own model, a finite-element code
for instance, is an entry point of group `softclose.models` and is named by `model.name` in a campaign.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike

from softclose.plugins import MODELS
from softclose.plugins import ModelError as ModelError
from softclose.waveform import Waveform

if TYPE_CHECKING:  # the compiler takes half a second to import, and reading a configuration needs none of it
    from softclose.device.simulate import Responses


class CannotSimulate(RuntimeError):
    """A device model's own word that it has no answer to this waveform: the candidate is recorded as failed."""


FAILURES: tuple[type[Exception], ...] = (CannotSimulate, ArithmeticError, ValueError)
"""What counts as a device model's own word: it would be raised anywhere. Everything else is the machine's fault."""


class DeviceModel(Protocol):
    """What a campaign calls: `softclose.simulate` is one. Deterministic, and each row independent of the others.

    A waveform that it cannot answer at all: CannotSimulate, ValueError or ArithmeticError, and the candidate is
    recorded as failed. A switch that it cannot integrate: a `status` other than 0.
    """

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


def measured(*_: Any, **__: Any) -> Responses:
    """In place of a model, where responses are measured. Raises ModelError whatever it is asked."""
    raise ModelError(
        "the responses of this campaign are measured (model.name is measured): nothing of it can be simulated; drive "
        "it with softclose_workflows.api.Bench"
    )


def load_model(name: str) -> DeviceModel:
    """The device model of that name. Raises ModelError naming the nearest one."""
    return cast(DeviceModel, MODELS.load(name))
