"""Owns the opening of a stored design's lot, with and without a brake, told as a table or as JSON."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from softclose.digits import least_digits
from softclose.evaluate.pieces import Mapper, here
from softclose.opening import BAND, Opening, Openings, design_brake, judge_opening, opened
from softclose_workflows.analyses.certify import fresh_switches
from softclose_workflows.analyses.chosen import Chosen, choose
from softclose_workflows.run.needs import check_fresh
from softclose_workflows.run.opening import designed_opening
from softclose_workflows.tell.console import OnStep, wide_console
from softclose_workflows.tell.plain import finite, waveform_rows
from softclose_workflows.tell.tables import describe_waveform, share, with_interval

TRAINING = 500
"""Switches that a brake is designed on; it is judged on new ones."""
_TRAINING_SEED = 1_000_003
"""Added to the seed of the new switches: the brake is judged on switches that it was not designed on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedOpening:
    """One design's opening on new switches."""

    chosen: Chosen
    openings: Openings
    """Without and with a brake."""


def opening(
    path: str,
    *,
    at_us: float | None = None,
    candidate: int | None = None,
    brake: int = 0,
    watch_us: float | None = None,
    n_switches: int = 10_000,
    mapper: Mapper = here,
    listener: OnStep | None = None,
) -> JudgedOpening:
    """A stored waveform, let go at an instant: the campaign's own, or else its horizon.

    watch_us: how long the lot is simulated from then on; None: the campaign's own opening.watch_us.
    brake: waveforms to try for one; 0: the one that the campaign has designed, where it let go at that instant. Raises
    OpeningError and CertifyError.
    """
    check_fresh(n_switches, 1)
    chosen = choose(path, candidate)
    config = chosen.config
    if watch_us is not None:
        config = config.revised([f"opening.watch_us={watch_us!r}"])
    at = (config.opening.release_us or config.model.horizon_us) if at_us is None else at_us
    drive = opened(chosen.waveform, at)
    fresh = fresh_switches(config, n_switches, seed=chosen.seed)
    plain = judge_opening(config, fresh, drive, at_us=at, mapper=mapper)
    designed = None
    if brake:
        training = fresh_switches(config, TRAINING, seed=chosen.seed + _TRAINING_SEED)
        designed = design_brake(
            config, training, drive, at_us=at, budget=brake, seed=chosen.seed, mapper=mapper, listener=listener
        )
    elif at == config.opening.release_us and watch_us is None:
        own = designed_opening(path, chosen.candidate, mapper=mapper)
        designed = own.braked.released.waveform if own is not None and own.braked is not None else None
    braked = None if designed is None else judge_opening(config, fresh, designed, at_us=at, mapper=mapper)
    return JudgedOpening(chosen=chosen, openings=Openings(at_us=at, plain=plain, braked=braked))


def opening_words(found: Openings) -> str:
    """`overshoot 0.98 travels, with a brake (12.3 V from 281.2 µs, …) 0.67`."""
    told = f"overshoot {found.plain.overshoot:.3f} travels ({100 * found.plain.released.held.mean():.1f} % held)"
    if found.braked is None:
        return told
    brake = describe_waveform(waveform_rows(found.braked.released.waveform.rows())[-1:])
    return f"{told}, with a brake ({brake}) {found.braked.overshoot:.3f}"


def _time(value: float, lower: float, upper: float, watched_us: float) -> str:
    if math.isinf(value):
        return f"not within the {watched_us:g} µs simulated (--watch, opening.watch_us)"
    return with_interval(value, lower, upper, least_digits("µs"))


def print_openings(title: str, found: Openings, level: float) -> None:
    """One row without, one with the brake."""
    from rich.table import Table

    table = Table(title=title, title_justify="left", show_lines=True)
    table.add_column("release")
    for column in (
        f"overshoot, {100 * level:g} % [travels]",
        "touch again",
        "stuck closed",
        f"within {100 * BAND:g} % after [µs]",
    ):
        table.add_column(column, justify="right")
    for name, o in (("the holding pulse falls", found.plain), ("with a brake", found.braked)):
        if o is None:
            continue
        brake = describe_waveform(waveform_rows(o.released.waveform.rows())[-1:])
        table.add_row(
            name if o is found.plain else f"{name}: {brake}",
            with_interval(o.overshoot, *o.overshoot_interval, least=3),
            share(o.p_rebound.estimate, *o.p_rebound.wilson),
            share(o.p_stuck.estimate, *o.p_stuck.wilson),
            _time(o.rest_us, *o.rest_interval, float(o.released.times_us[-1])),
        )
    wide_console().print(table)


def openings_to_json(found: Openings) -> dict[str, Any]:
    """Plain values; undefined numbers are null."""

    def plain(o: Opening | None) -> dict[str, Any] | None:
        if o is None:
            return None
        return {
            "n": o.n,
            "overshoot": o.overshoot,
            "overshoot_interval": list(o.overshoot_interval),
            "p_rebound": o.p_rebound.estimate,
            "p_rebound_interval": list(o.p_rebound.wilson),
            "p_stuck": o.p_stuck.estimate,
            "p_stuck_interval": list(o.p_stuck.wilson),
            "rest_us": o.rest_us,
            "rest_interval_us": list(o.rest_interval),
            "waveform": waveform_rows(o.released.waveform.rows()),
        }

    values: dict[str, Any] = finite(
        {"at_us": found.at_us, "release": plain(found.plain), "braked": plain(found.braked)}
    )
    return values
