"""Owns quantities: what else is asked of a waveform and its lot, each an object with unit, value, interval and uses.

Speeds alone can be bought with anything else: with hold, with force, with time. A quantity is of every switch (its
level-quantile counts, at the end where it is bad), of the lot, or of the drive.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from softclose.arrays import FloatArray
from softclose.device.drives import Drives
from softclose.evaluate.chain import Chain, chain_of, drives_of
from softclose.evaluate.scoring import score
from softclose.metrics.intervals import NO_INTERVAL, Interval, quantile_estimate
from softclose.metrics.objective import Assessment
from softclose.plugins import QuantityError
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.switch.plate import EPSILON_0
from softclose.waveform import Drive, Waveform

if TYPE_CHECKING:
    from softclose.device.simulate import Responses

Per = Literal["switch", "lot", "drive"]
Use = Literal["objective", "limit", "axis", "line"]

EVERY_USE: frozenset[Use] = frozenset(("objective", "limit", "axis", "line"))

LOOKS_PER_US = 20
"""Looks at a drive in a microsecond, where its slope or its area is asked for."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Closing:
    """A lot's closing under one waveform: everything that a quantity may look at."""

    chain: Chain
    """Device and conditions."""
    lot: Lot
    """n switches."""
    waveform: Drive
    """What was commanded."""
    response: Responses
    """What they did."""
    held_V: FloatArray
    """(n,) voltage at each switch at the end of the simulation [V]."""
    assessment: Assessment | None = None
    """How it was judged; None where only quantities of switches and drives are asked for."""

    @property
    def judged(self) -> Assessment:
        """How it was judged."""
        if self.assessment is None:
            raise QuantityError("quantities of a lot follow from its assessment, which this closing has not")
        return self.assessment

    @classmethod
    def of(
        cls,
        config: CampaignConfig,
        lot: Lot,
        waveform: Drive,
        response: Responses,
        *,
        fresh: bool = True,
        for_everybody: bool = False,
    ) -> Closing:
        """Of a response that `respond` gave.

        Parameters
        ----------
        config : CampaignConfig
            Whose objective and conditions apply.
        lot : Lot
            n switches.
        waveform : Drive
            What drove them.
        response : Responses
            What they did, (n,) each.
        fresh : bool
            Whether they are independent random switches.
        for_everybody : bool
            Whether the drive was tailored to no switch.

        Returns
        -------
        Closing
        """
        chain = chain_of(config)
        return cls(
            chain=chain,
            lot=lot,
            waveform=waveform,
            response=response,
            assessment=score(config, response, fresh=fresh),
            held_V=held_voltages(chain, lot, waveform, drives_of(chain, lot, waveform, for_everybody=for_everybody)),
        )


def held_voltages(chain: Chain, lot: Lot, waveform: Drive, drives: Drives | None = None) -> FloatArray:
    """(n,) voltage at each switch at the end of the simulation [V].

    Behind an amplifier that answers in proportion it is that of the common command in proportion: at the end a command
    has been held for long. Behind another one every drive is delivered.

    drives: by default the lot's own.
    """
    drives, horizon = drives or drives_of(chain, lot, waveform), chain.device.horizon_us
    ones = np.ones(len(lot))
    volts, times, gain = (ones if f is None else f for f in (drives.volts, drives.times, drives.gain))
    delivery = drives.delivery
    if drives.is_common or not isinstance(waveform, Waveform) or delivery is None or delivery.is_linear:
        return np.asarray(volts * gain * float(drives.nominal(horizon).voltage(horizon)))
    each, which = np.unique(np.stack([volts, times, gain], axis=1), axis=0, return_inverse=True)
    last = [float(drives.delivered(horizon * b, a, b, g).voltage(horizon * b)) for a, b, g in each]
    return np.array(last)[which.reshape(-1)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Value:
    """One quantity of one closing."""

    estimate: float
    """NaN where it is not defined."""
    interval: Interval
    """At the assessment's confidence; of a drive's quantity the value itself."""
    n: int
    """Switches that it rests on; 0 for a drive's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """Something that is asked of a closing."""

    name: str
    """As configurations and scripts call it."""
    unit: str
    """Its unit; "1" for a pure number."""
    long_name: str
    """What it is, in words."""
    per: Per
    """Of every switch, of the lot, or of the drive."""
    better: Literal["low", "high"] = "low"
    """Which end is good: of a switch's quantity the level-quantile at the other end counts."""
    values: Callable[[Closing], FloatArray]
    """(n,) of every switch, NaN where it has none; (1,) of a drive; (3,) of a lot: estimate, lower, upper."""
    uses: frozenset[Use] = EVERY_USE
    """What it may be: objective, limit, axis of a front, line of a report."""

    @property
    def is_share(self) -> bool:
        """Whether it is a share of the lot, which people read in per cent; how many impacts a switch has is none."""
        return self.unit == "1" and self.per == "lot"

    @property
    def bound(self) -> Literal["at most", "at least"]:
        """Which side of a limit is good."""
        return "at most" if self.better == "low" else "at least"

    def of(self, closing: Closing) -> Value:
        """Its value, with a distribution-free interval of order statistics where it is of every switch."""
        found, a = np.asarray(self.values(closing), dtype=np.float64), closing.judged
        if self.per == "lot":
            return Value(estimate=float(found[0]), interval=(float(found[1]), float(found[2])), n=a.n)
        return self.of_column(found, level=a.level, confidence=a.confidence, has_interval=a.intervals_valid)

    def of_column(self, values: FloatArray, *, level: float, confidence: float, has_interval: bool) -> Value:
        """Its value from those of the switches; not of a lot's quantity.

        Parameters
        ----------
        values : ndarray
            (n,) of the switches, or of a drive, whose first counts.
        level : float
            Of the quantile.
        confidence : float
            Of the interval.
        has_interval : bool
            Whether an interval holds for these switches.

        Returns
        -------
        Value
        """
        if self.per == "drive":
            value = float(values[0])
            return Value(estimate=value, interval=(value, value), n=0)
        ordered = np.sort(values[~np.isnan(values)])
        if not ordered.size:
            return Value(estimate=math.nan, interval=NO_INTERVAL, n=0)
        if self.better == "low":
            value, interval = quantile_estimate(ordered, level, confidence)
        else:  # the level-quantile from above: of the mirrored values
            value, (low, high) = quantile_estimate(-ordered[::-1], level, confidence)
            value, interval = -value, (-high, -low)
        return Value(estimate=value, interval=interval if has_interval else NO_INTERVAL, n=int(ordered.size))


def _of_assessment(estimate: str, interval: str) -> Callable[[Closing], FloatArray]:
    def values(c: Closing) -> FloatArray:
        low, high = getattr(c.judged, interval)
        return np.array([getattr(c.judged, estimate), low, high])

    return values


def _open(c: Closing) -> FloatArray:
    p = c.judged.p_nc_intervals
    return np.array([p.estimate, *p.wilson])


def _impacts(c: Closing) -> FloatArray:
    """(n, k) speeds of the impacts [µm/µs], NaN behind the last. Raises QuantityError where some are not known."""
    speeds = c.response.impact_speed
    if speeds is None or (np.asarray(c.response.n_impacts) > np.asarray(speeds).shape[1]).any():
        raise QuantityError(
            "the response does not keep every impact: keep as many as occur (store.max_impacts of a campaign)"
        )
    return np.asarray(speeds, dtype=np.float64)


def _touched(c: Closing, values: FloatArray) -> FloatArray:
    if c.response.n_impacts is None:
        raise QuantityError("the response does not tell its contacts: where it is an old certificate's, certify again")
    return np.where(np.asarray(c.response.n_impacts) > 0, values, math.nan)


def _kinetic(c: Closing) -> FloatArray:
    return 0.5 * c.lot["M"][:, None] * _impacts(c) ** 2  # µg (µm/µs)² is nJ


def _impulse(c: Closing) -> FloatArray:
    return c.lot["M"][:, None] * (1.0 + c.chain.device.restitution) * _impacts(c)  # µg µm/µs is nN s


def _largest(c: Closing, each: FloatArray) -> FloatArray:
    return _touched(c, np.where(np.isnan(each), -np.inf, each).max(axis=1, initial=0.0))


def _sum(c: Closing, each: FloatArray) -> FloatArray:
    return _touched(c, np.nansum(each, axis=1))


def _contact(c: Closing) -> FloatArray:
    return _touched(c, np.asarray(c.response.first_contact_us, dtype=np.float64))


def _bounce(c: Closing) -> FloatArray:
    held = np.where(np.asarray(c.response.closed), np.asarray(c.response.settling_us), math.nan)
    return np.asarray(held - _contact(c))


def _closed(c: Closing, values: FloatArray) -> FloatArray:
    return np.where(np.asarray(c.response.closed), values, math.nan)


def hold_margins(chain: Chain, lot: Lot, held_V: FloatArray) -> FloatArray:
    """(n,) hold voltage above the voltage at which each switch lets go [V]; NaN for a model of somebody else's.

    held_V: (n,) voltage at each switch at the end of the simulation [V].
    """
    return np.asarray(np.abs(held_V) - chain.device.holding_voltage(lot.switches))


def _margin(c: Closing) -> FloatArray:
    return hold_margins(c.chain, c.lot, c.held_V)


def _contact_force(c: Closing) -> FloatArray:
    return _closed(c, c.chain.device.contact_force(c.lot.switches, c.held_V))


def _release_force(c: Closing) -> FloatArray:
    return -c.chain.device.contact_force(c.lot.switches, np.zeros(len(c.lot))) - float(
        np.max(c.chain.device.losses.adhesion_uN)
    )


def _stored(c: Closing) -> FloatArray:
    if c.chain.device.modes is not None:
        return np.full(len(c.lot), math.nan)
    farads = 1e-6 * EPSILON_0 * c.chain.device.plate_area_um2 / (c.lot["G"] - c.lot["D"])
    return _closed(c, 0.5e12 * farads * c.held_V**2)


def _looks(c: Closing) -> tuple[FloatArray, FloatArray]:
    """Instants [µs] and volts of the common drive as it is delivered."""
    horizon = c.chain.device.horizon_us
    t = np.linspace(0.0, horizon, math.ceil(LOOKS_PER_US * horizon) + 1)
    drives = drives_of(c.chain, c.lot, c.waveform, for_everybody=True)
    return t, np.asarray(drives.nominal(horizon).voltage(t))


def _peak(c: Closing) -> FloatArray:
    return np.array([c.waveform.max_voltage(c.chain.device.horizon_us)])


def _slope(c: Closing) -> FloatArray:
    t, u = _looks(c)
    return np.array([np.abs(np.diff(u)).max() / (t[1] - t[0])])


def _area(c: Closing) -> FloatArray:
    t, u = _looks(c)
    return np.array([np.trapezoid(np.abs(u), t)])


QUANTITIES: dict[str, Quantity] = {
    q.name: q
    for q in (
        Quantity(
            name="v_u", unit="cm/s", long_name="upper velocity", per="lot",
            values=_of_assessment("v_u_cm_s", "v_u_interval"),
        ),
        Quantity(name="p_nc", unit="1", long_name="fraction of switches not closed", per="lot", values=_open),
        Quantity(
            name="cvar", unit="cm/s", long_name="mean speed of the fastest switches", per="lot",
            values=_of_assessment("cvar_cm_s", "cvar_interval"),
        ),
        Quantity(
            name="mean", unit="cm/s", long_name="mean speed", per="lot",
            values=_of_assessment("mean_cm_s", "mean_interval"),
        ),
        Quantity(
            name="closing", unit="µs", long_name="closing time", per="lot",
            values=_of_assessment("closing_us", "closing_interval"),
        ),
        Quantity(name="peak", unit="V", long_name="largest voltage commanded", per="drive", values=_peak),
        Quantity(name="slope", unit="V/µs", long_name="steepest slope delivered", per="drive", values=_slope),
        Quantity(
            name="volt_time", unit="V µs", long_name="area under the magnitude of the voltage", per="drive",
            values=_area,
        ),
        Quantity(
            name="hold_margin", unit="V", long_name="hold voltage above the voltage at which the switch lets go",
            per="switch", better="high", values=_margin,
        ),
        Quantity(
            name="contact_force", unit="µN", long_name="force on the closed contact", per="switch", better="high",
            values=_contact_force,
        ),
        Quantity(
            name="release_force", unit="µN", long_name="force that opens the contact once the voltage is gone",
            per="switch", better="high", values=_release_force,
        ),
        Quantity(
            name="impact_energy", unit="nJ", long_name="kinetic energy of the hardest impact", per="switch",
            values=lambda c: _largest(c, _kinetic(c)),
        ),
        Quantity(
            name="impact_energy_sum", unit="nJ", long_name="kinetic energy of all impacts", per="switch",
            values=lambda c: _sum(c, _kinetic(c)),
        ),
        Quantity(
            name="impulse", unit="nN s", long_name="impulse of the hardest impact", per="switch",
            values=lambda c: _largest(c, _impulse(c)),
        ),
        Quantity(
            name="impulse_sum", unit="nN s", long_name="impulse of all impacts", per="switch",
            values=lambda c: _sum(c, _impulse(c)),
        ),
        Quantity(
            name="impacts", unit="1", long_name="number of impacts", per="switch",
            values=lambda c: _touched(c, np.asarray(c.response.n_impacts, dtype=np.float64)),
        ),
        Quantity(
            name="contact_time", unit="µs", long_name="instant of the first contact", per="switch", values=_contact,
        ),
        Quantity(
            name="bounce_time", unit="µs", long_name="time from the first contact until it is held", per="switch",
            values=_bounce,
        ),
        Quantity(
            name="stored_energy", unit="pJ", long_name="electrical energy in the closed gap, lost at every opening",
            per="switch", values=_stored,
        ),
    )
}  # fmt: skip
"""Every quantity by its name. Those of contact and hold are NaN for a device model of somebody else's."""


def quantity(name: str) -> Quantity:
    """The quantity of a name; raises QuantityError naming those that there are."""
    if name not in QUANTITIES:
        raise QuantityError(f"{name!r} is no quantity; there are {', '.join(QUANTITIES)}")
    return QUANTITIES[name]
