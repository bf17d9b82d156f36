"""Owns `simulate`: validated input in, one `Responses` out. The device model behind it is the kernel's."""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softclose.arrays import FloatArray
from softclose.device.status import Status as Status
from softclose.glance import as_table, as_text
from softclose.kernel import dispatch
from softclose.population.lot import Lot
from softclose.switch.losses import Losses
from softclose.switch.plate import V_STICK, OtherAreaError, plate_area_of
from softclose.switch.reduced_order import ReducedOrder
from softclose.waveform import MAX_VOLTS, AnyDrive, Waveform
from softclose.waveform.scales import Scales

if TYPE_CHECKING:
    import xarray as xr


RTOL_RANGE = (1e-13, 1e-6)
"""Tolerances that the methods are built for: below, rounding; above, steps too long to look for impacts in."""


class SimulationError(ValueError):
    """Input that cannot be simulated."""


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Responses:
    """What every switch of an ensemble did under one waveform, in the order of the input.

    Of a switch whose `status` is not OK nothing is told, whichever model integrated it: not closed, no impacts, and NaN
    for every other number (`x` and `v` stand as far as they were integrated). Nothing behind needs a mask of its own.
    """

    max_contact_speed: FloatArray
    """(n,) V of Eq. 7, largest speed just before an impact [µm/µs]; NaN where the switch never touched."""
    first_contact_us: FloatArray
    """(n,) instant of the first impact [µs]; inf where there was none."""
    closed: NDArray[np.bool_]
    """(n,) held in contact at the horizon."""
    settling_us: FloatArray
    """(n,) instant from which the switch is held until the horizon [µs]; inf where it is not closed."""
    n_impacts: NDArray[np.int32]
    """(n,) number of impacts within the horizon."""
    final_x: FloatArray
    """(n,) travel at the horizon [µm]."""
    final_v: FloatArray
    """(n,) velocity at the horizon [µm/µs]."""
    status: NDArray[np.int8]
    """(n,) `Status` of the integration; never raised."""
    impact_time_us: FloatArray | None = None
    """(n, max_impacts) instants of the first impacts [µs], padded with NaN."""
    impact_speed: FloatArray | None = None
    """(n, max_impacts) their speeds just before contact [µm/µs], padded with NaN."""
    mode_peak_um: FloatArray | None = None
    """(n, n_modes) largest displacement of the contact by each mode until the first impact [µm]; None without modes."""
    times_us: FloatArray | None = None
    """(n_time,) instants of x and v [µs]."""
    x: NDArray[Any] | None = None
    """(n, n_time) travel [µm]."""
    v: NDArray[Any] | None = None
    """(n, n_time) velocity [µm/µs]; just before the impact where an instant is exactly one."""
    mode_x: NDArray[Any] | None = None
    """(n, n_modes - 1, n_time) parts of the second and further modes in x [µm]; None where they were not asked for."""
    mode_v: NDArray[Any] | None = None
    """(n, n_modes - 1, n_time) parts of them in v [µm/µs]."""
    asked: FloatArray | None = None
    """(n, k) what else a campaign asks for of each switch (`softclose.evaluate.asked`), NaN where it has none."""

    def __post_init__(self) -> None:
        failed = np.asarray(self.status) != Status.OK
        if not failed.any():
            return
        for name, void in _UNTOLD.items():
            values = getattr(self, name)
            if values is not None:
                array = np.array(values)
                array[failed] = void
                object.__setattr__(self, name, array)

    def to_xarray(self) -> xr.Dataset:
        """The same, labelled: dimensions switch, impact and time, each variable with its unit and what it is."""
        import xarray as xr

        found: dict[str, Any] = {}
        for name, (rest, unit, meaning) in _LABELS.items():
            values = getattr(self, name)
            if values is not None:
                found[name] = (("switch", *rest), values, {"units": unit, "long_name": meaning})
        time = {} if self.times_us is None else {"time": ("time", self.times_us, {"units": "µs"})}
        return xr.Dataset(found, coords=time)

    def _lines(self) -> list[tuple[str, str]]:
        v, n = np.asarray(self.max_contact_speed) * 100.0, len(self.max_contact_speed)
        touched, failed = v[np.isfinite(v)], int(np.count_nonzero(self.status))
        speeds = f"{np.median(touched):.2f} cm/s (median), {touched.max():.2f} at most" if touched.size else "–"
        return [
            ("touch", f"{touched.size:,} of {n:,}"),
            ("closed at the end", f"{int(np.count_nonzero(self.closed)):,} of {n:,}"),
            ("contact speed V", speeds),
            *([("not integrated", f"{failed:,} of {n:,}")] if failed else []),
        ]

    def __repr__(self) -> str:
        return as_text(f"Responses of {len(self.max_contact_speed):,} switches", self._lines())

    def _repr_html_(self) -> str:
        return as_table(f"Responses of {len(self.max_contact_speed):,} switches", self._lines())


_UNTOLD: dict[str, Any] = {
    "max_contact_speed": math.nan,
    "first_contact_us": math.nan,
    "closed": False,
    "settling_us": math.nan,
    "n_impacts": 0,
    "final_x": math.nan,
    "final_v": math.nan,
    "impact_time_us": math.nan,
    "impact_speed": math.nan,
    "mode_peak_um": math.nan,
}
"""Variable -> what stands in it for a switch that was not integrated to the horizon."""

_LABELS: dict[str, tuple[tuple[str, ...], str, str]] = {
    "max_contact_speed": ((), "µm/µs", "largest speed just before an impact"),
    "first_contact_us": ((), "µs", "first impact"),
    "closed": ((), "1", "held in contact at the horizon"),
    "settling_us": ((), "µs", "held from here to the horizon"),
    "n_impacts": ((), "1", "impacts within the horizon"),
    "final_x": ((), "µm", "travel at the horizon"),
    "final_v": ((), "µm/µs", "velocity at the horizon"),
    "status": ((), "1", "outcome of the integration; 0: ok, 1: too many steps, 2: collapsed, 3: left its table"),
    "impact_time_us": (("impact",), "µs", "instants of the first impacts"),
    "impact_speed": (("impact",), "µm/µs", "speeds just before them"),
    "mode_peak_um": (("mode",), "µm", "largest displacement by each mode until the first impact"),
    "x": (("time",), "µm", "travel"),
    "v": (("time",), "µm/µs", "velocity"),
    "mode_x": (("further_mode", "time"), "µm", "part of each further mode in the travel"),
    "mode_v": (("further_mode", "time"), "µm/µs", "part of each further mode in the velocity"),
}
"""Variable -> its dimensions beside the switch, its unit, what it is."""


def simulate(
    switches: Lot | ArrayLike,
    waveform: AnyDrive | FloatArray,
    *,
    horizon_us: float = 250.0,
    restitution: float | FloatArray = 0.5,
    plate_area_um2: float | None = None,
    rtol: float = 1e-9,
    times_us: ArrayLike | None = None,
    method: Literal["taylor", "rk"] = "taylor",
    threads: int = 1,
    max_impacts: int = 0,
    dtype: type[np.float64] | type[np.float32] = np.float64,
    max_volts: float = MAX_VOLTS,
    v_stick: float = V_STICK,
    max_steps: int = dispatch.MAX_STEPS,
    losses: Losses | None = None,
    modes: ReducedOrder | None = None,
    drive_volts: FloatArray | None = None,
    drive_times: FloatArray | None = None,
    further_modes: bool = False,
) -> Responses:
    """Integrate Eqs. 1-2 for every switch under one waveform; with losses or several modes, what takes their place.

    Row i depends on switches[i] and the settings only: not on other rows, on threads, or on which outputs are wanted.
    Never raises for a switch that cannot be integrated: see `Responses.status`.

    Parameters
    ----------
    switches : Lot or (n, 4) array-like of float64
        Columns D [µm], G [µm], K [N/m], M [µg].
    waveform : Waveform, Delivered, Pieced, Fitted, Trace or (n_pulse, 4) ndarray of float64
        The drive voltage; an array has rows of start, rise, flat top [µs] and volts, as stores keep them. Of a
        trace with many samples polynomials are simulated that have the same area (`Fitted.of`).
    horizon_us : float
        End of the simulation [µs].
    restitution : float or (n,) ndarray
        Speed after an impact over speed before it, in [0, 1]; an array has one entry a switch.
    plate_area_um2 : float, optional
        Plate area A of Eq. 1 [µm²]: by default that of the population that the switches were drawn from, where it has
        one, else 16,700.
    rtol : float
        Local error per step relative to travels of 1 µm and speeds of 0.1 µm/µs.
    times_us : (n_time,) array-like of float64, optional
        Sorted instants in [0, horizon] [µs] to sample x and v at.
    method : {"taylor", "rk"}
        "taylor" is the fast kernel, "rk" its readable Runge-Kutta twin.
    threads : int
        Threads that share the switches.
    max_impacts : int
        Impacts kept per switch.
    dtype : float64 or float32
        Of the sampled x and v.
    max_volts : float
        Waveforms above it [V] are refused.
    v_stick : float
        Rebound speed [µm/µs] below which a pressed switch is held.
    max_steps : int
        Work limit per switch.
    losses : Losses, optional
        Damping, film of gas and adhesion, the same for all switches or one entry each. The twin with losses is the
        Runge-Kutta method of several modes.
    modes : ReducedOrder, optional
        The modes of the switch: K and M are those of the first, with the others in proportion.
    drive_volts, drive_times : (n,) ndarray of float64, optional
        What the volts and the times of each switch's command are multiplied by; of a delivered drive the command's, its
        way does not scale. A switch is seen until its own horizon, the time scale times `horizon_us`, and sampled at as
        many times `times_us`. The Taylor kernels take them.
    further_modes : bool
        Sample the second and further modes by themselves, too.

    Returns
    -------
    Responses
        (n,) arrays, one entry a switch; see there for units.

    Raises
    ------
    SimulationError
        For input outside these limits (a ValueError).
    WaveformError
        For a waveform above max_volts.
    """
    table = _check_switches(switches.switches if isinstance(switches, Lot) else switches)
    horizon = _number("horizon_us", horizon_us, low=0.0, high=1e6, unit=" µs")
    eta = _restitution(restitution, len(table))
    asked = None if plate_area_um2 is None else _area(plate_area_um2)
    try:
        area = plate_area_of(switches, asked)
    except OtherAreaError as e:
        raise SimulationError(str(e)) from e
    stick = _number("v_stick", v_stick, low=0.0, high=math.inf, unit=" µm/µs")
    tolerance = _number("rtol", rtol, low=0.0, high=RTOL_RANGE[1])
    if tolerance < RTOL_RANGE[0]:
        raise SimulationError(f"rtol is {rtol!r}; below {RTOL_RANGE[0]:g} rounding dominates: use a larger one")
    if method not in dispatch.METHODS:
        raise SimulationError(f"method is {method!r}; it must be one of {', '.join(dispatch.METHODS)}")
    if isinstance(waveform, np.ndarray) and waveform.ndim == 2 and waveform.shape[1] == 4:
        waveform = Waveform.from_rows(waveform)
    if not isinstance(waveform, AnyDrive):
        raise SimulationError(
            f"waveform is a {type(waveform).__name__}; it must be a softclose.Waveform, e.g. Waveform([Pulse(...)])"
        )
    waveform.check(max_volts, horizon)
    if np.dtype(dtype) not in (np.dtype(np.float32), np.dtype(np.float64)):
        raise SimulationError(f"dtype is {dtype!r}; x and v can be written as numpy.float32 or numpy.float64")
    times = np.zeros(0) if times_us is None else _check_times(times_us, horizon)
    n_events = _count("max_impacts", max_impacts, 0)
    if losses is not None and not isinstance(losses, Losses):
        raise SimulationError(f"losses is a {type(losses).__name__}; it must be a softclose.Losses")
    if losses is not None:
        losses.check_rows(len(table))
    if modes is not None and not isinstance(modes, ReducedOrder):
        raise SimulationError(f"modes is a {type(modes).__name__}; it must be a softclose.ReducedOrder")
    if modes is not None:
        _check_reach(modes, table)
    scales = _scales(drive_volts, drive_times, len(table))
    lost = losses if losses is not None else Losses()
    if scales is not None and not (method == "taylor" and dispatch.in_series(modes, lost)):
        raise SimulationError(
            "drive_volts and drive_times are for what the Taylor kernels simulate (method 'taylor'; one mode that "
            "moves contact and electrode alike, or two between plates with no film that slips; a rigid contact): "
            "simulate drive by drive"
        )
    out = dispatch.run(
        table,
        waveform,
        horizon_us=horizon,
        restitution=eta,
        plate_area_um2=area,
        rtol=tolerance,
        times_us=times,
        method=method,
        threads=_count("threads", threads, 1),
        max_impacts=n_events,
        dtype=dtype,
        v_stick=stick,
        max_steps=_count("max_steps", max_steps, 1),
        losses=lost,
        modes=modes,
        scales=scales,
        further_modes=further_modes and times_us is not None,
    )
    if scales is not None:
        _unscale(out, scales.times)
    sampled, n = times_us is not None, len(table)
    return Responses(
        max_contact_speed=out.metrics[0],
        first_contact_us=out.metrics[1],
        settling_us=out.metrics[2],
        final_x=out.metrics[3],
        final_v=out.metrics[4],
        closed=out.closed,
        n_impacts=out.n_impacts,
        status=out.status,
        mode_peak_um=out.peaks,
        impact_time_us=out.impact_time[:n] if n_events else None,
        impact_speed=out.impact_speed[:n] if n_events else None,
        times_us=times if sampled else None,
        x=(out.x if len(times) else np.zeros((n, 0), dtype=dtype)) if sampled else None,
        v=(out.v if len(times) else np.zeros((n, 0), dtype=dtype)) if sampled else None,
        mode_x=out.mode_x if len(times) else None,
        mode_v=out.mode_v if len(times) else None,
    )


def _area(given: float) -> float:
    return _number("plate_area_um2", given, low=0.0, high=math.inf, unit=" µm²")


def _check_reach(modes: ReducedOrder, table: FloatArray) -> None:
    """The electrode stays within its gap, and within the table of the capacitance, where the contact is made."""
    unit = modes.mode[0].electrode / modes.mode[0].contact
    at_contact = unit * table[:, 0]
    if (at_contact >= table[:, 1]).any():
        i = int((at_contact / table[:, 1]).argmax())
        raise SimulationError(
            f"switches row {i}: mode 1 takes the electrode to {at_contact[i]:g} µm at contact, through its gap of "
            f"{table[i, 1]:g} µm: check the participations of mode 1"
        )
    c = modes.capacitance
    if c is not None and c.travel_um and (at_contact / table[:, 1]).max() > c.travel_um[-1] / c.gap_um:
        i = int((at_contact / table[:, 1]).argmax())
        raise SimulationError(
            f"switches row {i} closes at {at_contact[i] / table[i, 1]:.3f} of its gap, and the capacitance's table "
            f"ends at {c.travel_um[-1] / c.gap_um:.3f}: give it up to there"
        )


def _by_name(frame: Any, columns: list[Any]) -> FloatArray:
    missing = [name for name in "DGKM" if columns.count(name) != 1]
    if missing:
        raise TypeError(f"the table has no column {missing[0]}, or several")
    values: FloatArray = frame[list("DGKM")].to_numpy()
    return values


def _check_switches(switches: ArrayLike) -> FloatArray:
    try:
        if np.iscomplexobj(switches):
            raise TypeError("complex numbers")
        if np.ma.is_masked(switches):
            raise TypeError("some entries are masked")
        columns = getattr(switches, "columns", None)
        if columns is not None and hasattr(switches, "to_numpy"):  # a data frame: by name, not by position
            switches = _by_name(switches, list(columns))
        table = np.ascontiguousarray(switches, dtype=np.float64)
    except (TypeError, ValueError) as e:
        raise SimulationError(f"switches cannot be read as numbers ({e}); give an (n, 4) array D, G, K, M") from e
    if table.ndim != 2 or table.shape[1] != 4:
        raise SimulationError(
            f"switches has shape {table.shape}; it must be (n, 4): D [µm], G [µm], K [N/m], M [µg] of each switch"
        )
    d, g, k, m = table.T
    for bad, rule in (
        (~np.isfinite(table).all(axis=1), "every entry must be finite"),
        (~(d > 0.0), "the travel D must be above 0 µm"),
        (~(g > d), "the gap G must be wider than the travel D"),
        (~(k > 0.0), "the stiffness K must be above 0 N/m"),
        (~(m > 0.0), "the mass M must be above 0 µg"),
    ):
        if bad.any():
            i = int(bad.argmax())
            row = ", ".join(f"{name} {value:g}" for name, value in zip("DGKM", table[i], strict=True))
            raise SimulationError(
                f"switches row {i} is {row}; {rule} ({int(bad.sum())} of {len(table)} rows): correct or drop such rows"
            )
    return table


def _check_times(times_us: ArrayLike, horizon: float) -> FloatArray:
    try:
        times = np.ascontiguousarray(times_us, dtype=np.float64)
    except (TypeError, ValueError) as e:
        raise SimulationError(f"times_us cannot be read as numbers ({e}); give sorted instants in µs") from e
    if times.ndim != 1:
        raise SimulationError(f"times_us has shape {times.shape}; it must be one-dimensional")
    if len(times) and not (times[0] >= 0.0 and times[-1] <= horizon and bool((np.diff(times) >= 0.0).all())):
        raise SimulationError(
            f"times_us runs from {times.min():g} to {times.max():g} µs; it must be sorted and within "
            f"[0, {horizon:g}] µs (the horizon): sort it or raise horizon_us"
        )
    return times


def _number(name: str, value: float, *, low: float, high: float, unit: str = "") -> float:
    """Value as a float in (low, high], or in (low, inf) where there is no upper limit."""
    try:
        number = float(value)
    except (TypeError, ValueError) as e:
        raise SimulationError(f"{name} is {value!r}; it must be a number") from e
    if not (low < number <= high and math.isfinite(number)):
        allowed = f"above {low:g}{unit}" + (f" and at most {high:g}{unit}" if math.isfinite(high) else " and finite")
        raise SimulationError(f"{name} is {number:g}{unit}; it must be {allowed}")
    return number


def _scales(volts: FloatArray | None, times: FloatArray | None, n: int) -> Scales | None:
    """Scales of n commands; None where none is scaled."""
    if volts is None and times is None:
        return None
    found = []
    for name, given in (("drive_volts", volts), ("drive_times", times)):
        values = np.ones(n) if given is None else np.asarray(given, dtype=np.float64)
        if values.shape != (n,):
            raise SimulationError(f"{name} has shape {values.shape}; it must be ({n},), one factor a switch")
        bad = np.flatnonzero(~((values > 0.0) & np.isfinite(values)))
        if bad.size:
            raise SimulationError(f"{name} of switch {bad[0]} is {values[bad[0]]:g}; it must be above 0 and finite")
        found.append(values)
    return Scales(volts=found[0], times=found[1])


def _unscale(out: dispatch.KernelOutput, times: FloatArray) -> None:
    """Times and speeds of switches whose drives' times are scaled, in place."""
    out.metrics[1:3] *= times
    out.metrics[[0, 4]] /= times
    for values, factor in ((out.impact_time, times), (out.impact_speed, 1.0 / times), (out.v, 1.0 / times)):
        if values.shape[1]:
            values *= factor[:, None].astype(values.dtype)
    if out.mode_v is not None and out.mode_v.shape[2]:
        np.multiply(out.mode_v, (1.0 / times)[:, None, None].astype(out.mode_v.dtype), out=out.mode_v)


def _restitution(value: float | FloatArray, n: int) -> float | FloatArray:
    """One number, or one of each switch."""
    if not isinstance(value, np.ndarray):
        return _number("restitution", value, low=0.0, high=1.0)
    if value.shape != (n,) or value.dtype.kind not in "fiu":
        raise SimulationError(
            f"restitution has shape {value.shape} and type {value.dtype}; it must be a number or ({n},), one a switch"
        )
    bad = np.flatnonzero(~((value > 0.0) & (value <= 1.0)))
    if bad.size:
        raise SimulationError(f"restitution of switch {bad[0]} is {value[bad[0]]:g}; it must be above 0 and at most 1")
    return value.astype(np.float64)


def _count(name: str, value: int, low: int) -> int:
    try:
        number = operator.index(value)
    except TypeError as e:
        raise SimulationError(f"{name} is {value!r}; it must be a whole number") from e
    if number < low:
        raise SimulationError(f"{name} is {number}; it must be at least {low}")
    return number
