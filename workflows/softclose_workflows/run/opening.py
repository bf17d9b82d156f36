"""Owns the opening that a campaign designs: of a candidate, on its training switches, kept in the store.

A release begins when the lot has long been held, so that nothing of the closing but the holding pulse reaches it: it is
designed after the search, for a candidate that the search has found (ADR 082).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.evaluate.pieces import Mapper, Sent, here
from softclose.opening import (
    Opening,
    OpeningError,
    Openings,
    Released,
    Trial,
    assess_opening,
    design_brake,
    judge_opening,
    opened,
)
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store import (
    Campaign,
    DamageError,
    GroupArray,
    StoreMissingError,
    open_campaign,
    read_group,
    write_group,
)
from softclose_workflows.run import releases
from softclose_workflows.run.records import padded_rows, parameters, unpadded
from softclose_workflows.run.releases import Releases
from softclose_workflows.terminal import say

GROUP = "opening"
"""Group of the store that holds the designed openings, one a candidate."""

_PER_SWITCH = {
    "held": ("1", "held when the fall began; of the others nothing is said"),
    "stuck": ("1", "never leaving the contact"),
    "rebound": ("1", "touching the contact again"),
    "overshoot": ("1", "largest displacement beyond rest, in travels; NaN: not held"),
    "rest_us": ("µs", "time from the begin of the fall until it stays near rest; inf: not in time, NaN: not held"),
}


def name_of(candidate: int) -> str:
    """The group of one candidate's opening."""
    return f"{GROUP}/{candidate}"


def candidate_of(group: str) -> int | None:
    """The inverse of `name_of`; None for a group of another kind."""
    kind, _, number = group.partition("/")
    return int(number) if kind == GROUP and number.isdecimal() else None


def designed_opening(path: str, candidate: int, *, mapper: Mapper = here) -> Openings | None:
    """The opening of a candidate on the training switches: as stored, or else designed and stored.

    A pure function of the campaign; None where it designs none. What is damaged is designed again. Raises
    OpeningError where the waveform does not hold, or fewer switches than tell anything.
    """
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    if not config.opening.is_designed:
        return None
    try:
        stored = read_opening(path, candidate)
    except DamageError:  # a pure function of the campaign: it comes out the same again
        stored = None
    if stored is not None:
        return stored
    found = _design(campaign, config, candidate, mapper)
    write_group(
        path,
        name_of(candidate),
        opening_arrays(found, "switch"),
        {"candidate": candidate, "release_us": found.at_us},
        replace=True,
    )
    return found


def read_opening(path: str, candidate: int) -> Openings | None:
    """The stored opening of a candidate; None where there is none. Raises DamageError."""
    config, name = CampaignConfig.from_dict(open_campaign(path).config), name_of(candidate)
    try:
        return openings_of(config, read_group(path, name).arrays)
    except StoreMissingError:
        return None
    except (KeyError, IndexError, TypeError) as e:
        raise DamageError(
            f"group {name} of {path} is no opening ({type(e).__name__}: {e}): run `softclose verify {path} --repair`"
        ) from e


def keep_releases(path: str, candidate: int, *, mapper: Mapper = here) -> str:
    """Keep the motion under every release tried for a candidate, all of it tried again, which leaves its opening alone.

    Returns why not; empty where it is done. Raises what `designed_opening` raises.
    """
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    if not (config.opening.is_designed and config.store.trials):
        return f"{releases.name_of(candidate)} of {path} belongs to no opening that this campaign keeps: delete it"
    _design(campaign, config, candidate, mapper)
    return ""


def _design(campaign: Campaign, config: CampaignConfig, candidate: int, mapper: Mapper) -> Openings:
    """The opening of a candidate. The motion under each waveform that is tried is kept on the way."""
    settings, switches = config.opening, Lot(campaign.population()).rows(slice(config.opening.n_switches))
    at = settings.release_us
    drive = opened(Waveform.from_rows(campaign.waveform(candidate)), at)
    plain = judge_opening(config, switches, drive, at_us=at, mapper=mapper)
    kept = Releases(campaign.path, config, candidate, len(switches)) if config.store.trials else None
    braked = None
    if settings.brake:
        to_keep: dict[str, Any] = {} if kept is None else {"attempt": kept.attempt, "told": kept.told}
        best = design_brake(
            config,
            switches,
            drive,
            at_us=at,
            budget=settings.brake,
            seed=config.campaign.seed,
            mapper=mapper,
            **to_keep,
        )
        braked = judge_opening(config, switches, best, at_us=at, mapper=mapper)
    elif kept is not None:
        alone = Trial(0, Sent(config), switches, drive, at)
        kept.told(alone, next(mapper(kept.attempt, [alone])))
    if kept is not None:
        kept.finish()
    return Openings(at_us=at, plain=plain, braked=braked)


def opening_arrays(found: Openings, switch: str) -> dict[str, GroupArray]:
    """What is stored of openings: the drives, and what each switch did; switch: what its dimension is called."""
    released = [o.released for o in (found.plain, found.braked) if o is not None]

    def of(name: str, dims: tuple[str, ...], unit: str, meaning: str) -> GroupArray:
        values = np.stack([getattr(r, name) for r in released])
        return GroupArray(dims=("release", *dims), values=values, unit=unit, long_name=meaning)

    n = len(released[0].held)
    return {
        "release": GroupArray(
            dims=("release",), values=np.array(["plain", "braked"][: len(released)]), long_name="without, with a brake"
        ),
        "quantile": GroupArray(dims=("quantile",), values=np.array([0.05, 0.5, 0.95]), long_name="of the switches"),
        "parameter": parameters(),
        switch: GroupArray(dims=(switch,), values=np.arange(n), long_name="index of the switch"),
        "release_waveform": GroupArray(
            dims=("release", "release_pulse", "parameter"),
            values=padded_rows([r.waveform for r in released]),
            unit="µs or V",
            long_name="start, rise, peak, volts of the whole drive, without and with a brake; rows of NaN are absent",
        ),
        "release_time": GroupArray(
            dims=("release_time",), values=released[0].times_us, unit="µs", long_name="since the begin of the fall"
        ),
        "release_quantiles": of("quantiles", ("quantile", "release_time"), "1", "5, 50 and 95 % of x / D"),
        **{f"release_{name}": of(name, (switch,), *words) for name, words in _PER_SWITCH.items()},
    }


def openings_of(config: CampaignConfig, arrays: Mapping[str, NDArray[Any]]) -> Openings | None:
    """The inverse of `opening_arrays`; None where there is none among the arrays."""
    if "release_waveform" not in arrays:
        return None
    found: list[Opening] = []
    for place, rows in enumerate(arrays["release_waveform"]):
        released = Released(
            waveform=unpadded(rows),
            times_us=arrays["release_time"],
            quantiles=arrays["release_quantiles"][place],
            **{name: arrays[f"release_{name}"][place] for name in _PER_SWITCH},
        )
        found.append(assess_opening(config, released))
    return Openings(at_us=config.opening.release_us, plain=found[0], braked=found[1] if len(found) > 1 else None)


def design_at_the_end(path: str, *, mapper: Mapper, quiet: bool = False) -> None:
    """What a finished campaign that designs an opening still has to do: that of its best candidate.

    quiet: nothing is said while it works, which may take as long as the campaign.
    """
    campaign = open_campaign(path)
    best = campaign.best()
    if best is None:
        return
    if not quiet and read_opening(path, best.candidate) is None:
        o = campaign.config["opening"]
        brake = f"a brake of {o['brake']:,} tries" if o["brake"] else "without a brake"
        say(f"designing how candidate {best.candidate} opens, {brake}, on {o['n_switches']:,} switches …", err=True)
    try:
        designed_opening(path, best.candidate, mapper=mapper)
    except OpeningError as e:
        say(f"note: no opening is designed for candidate {best.candidate}: {e}", err=True)
