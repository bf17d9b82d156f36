"""Owns the protocol of device models (switches × waveform -> responses).

Nothing outside a model may assume one degree of freedom or a cheap simulator. A user's own model, a finite-element code
for instance, is an entry point of group `softclose.models` and is named by `model.name` in a campaign.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike

from softclose.metrics.objective import MISSING
from softclose.plugins import MODELS
from softclose.plugins import ModelError as ModelError
from softclose.waveform import Waveform

if TYPE_CHECKING:  # the compiler takes half a second to import, and reading a configuration needs none of it
    from softclose.device.simulate import Responses


class CannotSimulate(RuntimeError):
    """A deterministic failure of the device model for this waveform: the candidate is recorded as failed."""


def is_own_word(failure: BaseException) -> bool:
    """Whether a failure is deterministic, so that it would occur on any machine: the candidate is recorded as failed.

    CannotSimulate, an ArithmeticError, or an error of this package's about what it was given. Everything else is the
    machine's fault: a model of the user's that raises ValueError("license server not reached") says nothing of the
    waveform.
    """
    if isinstance(failure, CannotSimulate | ArithmeticError):
        return True
    return isinstance(failure, ValueError) and type(failure).__module__.partition(".")[0] == "softclose"


class DeviceModel(Protocol):
    """What a campaign calls: `softclose.simulate` is one. Deterministic, and each row independent of the others.

    A waveform that it cannot answer at all: CannotSimulate (or an ArithmeticError), and the candidate is recorded as
    failed. A switch that it cannot integrate: a `status` other than 0. Anything else that it raises is taken for a
    fault of the machine: the work is tried again, then the run stops, and resumes.
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
        """switches: (n, 4) float64 D [µm], G [µm], K [N/m], M [µg]. `rtol` and `method` may mean nothing to a model.

        A model with settings of its own names them in an attribute `Options` (`softclose.device.options`), and is given
        them as `options`.
        """
        ...


def measured(*_: Any, **__: Any) -> Responses:
    """In place of a model, where responses are measured. Raises ModelError whatever it is asked."""
    raise ModelError(
        "the responses of this campaign are measured (model.name is measured): nothing of it can be simulated; drive "
        "it with softclose_workflows.api.Bench"
    )


def load_model(name: str) -> DeviceModel:
    """The device model of that name; answers of the user's own are checked. Raises ModelError naming the nearest."""
    model = cast(DeviceModel, MODELS.load(name))
    return model if name in MODELS.shipped else _checked(name, model)


def _checked(name: str, model: DeviceModel) -> DeviceModel:
    @functools.wraps(model)
    def simulate(switches: ArrayLike, waveform: Waveform, **settings: Any) -> Responses:
        found = model(switches, waveform, **settings)
        _check_answer(name, found, len(np.asarray(switches)))
        return found

    return cast(DeviceModel, simulate)


def _check_answer(name: str, found: Responses, n: int) -> None:
    """Raise ModelError where an answer contradicts itself: a switch that closed without a speed, missing rows."""
    speeds = np.asarray(found.max_contact_speed, dtype=np.float64)
    closed, status = np.asarray(found.closed), np.asarray(found.status)
    for what, values in (("max_contact_speed", speeds), ("closed", closed), ("status", status)):
        if values.shape != (n,):
            raise ModelError(f"model {name!r} gives {what} of shape {values.shape} for {n} switches; it must be ({n},)")
    if (status == MISSING).any():
        raise ModelError(
            f"model {name!r} gives the status {MISSING}, which stands for a reading that is missing; it "
            "must be 0 where a switch was integrated, and another number up to 126 where it was not"
        )
    integrated = status == 0
    with np.errstate(invalid="ignore"):
        wrong = integrated & (np.isinf(speeds) | (speeds < 0.0) | (closed.astype(bool) & np.isnan(speeds)))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ModelError(
            f"model {name!r} says that switch {i} is {'closed' if closed[i] else 'open'} and gives its contact speed "
            f"as {speeds[i]:g} µm/µs; it must be a number from 0 on, or NaN where the switch never touches. A switch "
            "that cannot be integrated has a status other than 0"
        )
