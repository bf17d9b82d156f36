"""Owns trajectories that are kept beside a campaign's blocks: of releases, actuations and certificates.

Each group in `trajectories` is a pure function of the campaign and of the group's own name. Workers write its parts,
the driver its metadata when all parts are there (`softclose_store.parts`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softclose.settings import CampaignConfig
from softclose_store import (
    CASE_PREFIX,
    GroupArray,
    StoreMissingError,
    group_attributes,
    write_group,
)
from softclose_store.parts import PartedArray, Parts, write_part
from softclose_workflows.run.creation import case_columns
from softclose_workflows.run.tasks import campaign_of

if TYPE_CHECKING:
    from softclose.device.simulate import Responses

GROUP = "trajectories"
"""Group of the store that holds them."""

MOST_RAW_BYTES, MOST_PARTS = 3.2e7, 10_000
"""Motion in one part, before compression; parts of an array along its switches."""

_MOTION = {
    "x": ("µm", "travel x(t)"),
    "v": ("µm/µs", "velocity v(t)"),
    "mode_x": ("µm", "part of each further mode in the travel"),
    "mode_v": ("µm/µs", "part of each further mode in the velocity"),
}


def has_group(path: str, name: str) -> bool:
    """Whether a group of trajectories is there, as a whole; one whose metadata are lost is none."""
    try:
        return group_attributes(path, name) is not None
    except StoreMissingError:
        return False


def rows_of_parts(config: CampaignConfig, n: int, *, most: int, motions: int) -> int:
    """Switches in a part: `most`, fewer where their motion would be large, more where parts would be too many.

    motions: of each switch in a part, on the campaign's number of instants.
    """
    bytes_a_switch = 8.0 * config.store.n_times * config.n_modes * motions
    fits = max(int(MOST_RAW_BYTES / bytes_a_switch), 1)
    return max(min(n, most, fits), math.ceil(n / MOST_PARTS), 1)


def motion_of(config: CampaignConfig, each: Sequence[Responses], looks: Any = slice(None)) -> dict[str, NDArray[Any]]:
    """x and v, and those of further modes, of n switches in each case: (n, [case], [mode], time) float32.

    looks: which of the sampled instants.
    """
    names = list(_MOTION) if config.n_modes > 1 else ["x", "v"]
    found = {}
    for name in names:
        values = [np.asarray(getattr(r, name), dtype=np.float32)[..., looks] for r in each]
        found[_stored(name, len(each))] = values[0] if len(each) == 1 else np.stack(values, axis=1)
    return found


def _stored(name: str, n_cases: int) -> str:
    """As in a stage: what has no prefix is what counts of a switch."""
    return name if n_cases == 1 else f"{CASE_PREFIX}{name}"


def outputs_of(config: CampaignConfig) -> dict[str, Any]:
    """What is asked of the device model, for `motion_of`."""
    return {"dtype": np.float32} | ({"further_modes": True} if config.n_modes > 1 else {})


@dataclass(frozen=True, slots=True, kw_only=True)
class Keeper:
    """Keeps the motion of switches in a group, in whichever process."""

    path: str
    """Path or URL of the store."""
    group: str
    """Such as `trajectories/release-3`."""
    arrays: Mapping[str, PartedArray]
    """Its motion."""
    n_leading: int
    """Dimensions before cases, modes and time."""
    durable: bool
    """Whether parts are flushed to the disk."""
    fingerprint: str
    """The campaign that the store has to hold, wherever a part is written."""

    @classmethod
    def of(
        cls,
        config: CampaignConfig,
        path: str,
        group: str,
        leading: Mapping[str, int],
        *,
        n_cases: int,
        time: str,
        n_times: int,
    ) -> Keeper:
        """For a campaign's motion at n_times instants.

        leading: dimensions that motion has before case, mode and time, and how much of each a part has; n_cases: in
        which each switch is simulated; time: what its dimension of time is called.
        """
        arrays = {}
        names = list(_MOTION) if config.n_modes > 1 else ["x", "v"]
        for name in names:
            dims, chunk = [*leading], [*leading.values()]
            if n_cases > 1:
                dims, chunk = [*dims, "case"], [*chunk, n_cases]
            if name.startswith("mode_"):
                dims, chunk = [*dims, "mode"], [*chunk, config.n_modes - 1]
            unit, long_name = _MOTION[name]
            arrays[_stored(name, n_cases)] = PartedArray(
                dims=(*dims, time), chunk=(*chunk, n_times), unit=unit, long_name=long_name
            )
        return cls(
            path=path,
            group=group,
            arrays=arrays,
            n_leading=len(leading),
            durable=config.store.durable,
            fingerprint=config.fingerprint(),
        )

    def keep(self, index: tuple[int, ...], motion: Mapping[str, NDArray[Any]]) -> dict[str, str]:
        """Write a part; returns its files and their sha256.

        motion: as `motion_of` makes it; leading dimensions of one element may be missing.
        """
        campaign_of(self.path, self.fingerprint)  # raises where another store, or none, is at the path here
        files: dict[str, str] = {}
        for name, array in self.arrays.items():
            values = motion[name]
            values = values.reshape((1,) * (len(array.dims) - values.ndim) + values.shape)
            whole = (*index, *[0] * (len(array.dims) - len(index)))
            files |= write_part(self.path, self.group, name, array, whole, values, durable=self.durable)
        return files

    def nothing(self, n: int) -> dict[str, NDArray[Any]]:
        """The motion of n switches that were not simulated."""
        rest = {name: array.chunk[self.n_leading :] for name, array in self.arrays.items()}
        return {name: np.full((n, *sizes), np.nan, dtype=np.float32) for name, sizes in rest.items()}

    def finish(
        self,
        config: CampaignConfig,
        leading: tuple[int, ...],
        files: Mapping[str, str],
        arrays: Mapping[str, GroupArray],
        attributes: Mapping[str, Any],
    ) -> None:
        """Put the group's metadata after its parts. leading: sizes; files: what `keep` returned, of all parts."""
        labels: dict[str, GroupArray] = {}
        if any("case" in array.dims for array in self.arrays.values()):
            labels["case"] = GroupArray(dims=("case",), values=np.arange(config.n_cases), long_name="index of the case")
            labels |= {
                c.name: GroupArray(dims=("case",), values=np.array(c.values), unit=c.unit, long_name=c.long_name)
                for c in case_columns(config)
            }
        if config.n_modes > 1:
            further = np.arange(2, config.n_modes + 1)
            labels["mode"] = GroupArray(dims=("mode",), values=further, long_name="index of the mode")
        parts = {
            name: Parts(
                array=array,
                shape=(*leading, *array.chunk[self.n_leading :]),
                files={member: digest for member, digest in files.items() if member.startswith(f"{name}/")},
            )
            for name, array in self.arrays.items()
        }
        write_group(self.path, self.group, {**labels, **arrays}, attributes, parts=parts, replace=True)
