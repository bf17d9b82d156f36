"""Owns how an ensemble reaches a kernel: flat arrays allocated, switches dealt to threads in contiguous blocks."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray
from softclose.kernel import pieces as drive_pieces
from softclose.kernel import rk, taylor, two_modes
from softclose.kernel.bounces import MAX_RETURNS
from softclose.switch.losses import SLIP, SLIP_EXPONENT, Losses
from softclose.switch.plate import EPSILON_0, V_STICK
from softclose.switch.reduced_order import ONE_MODE, ReducedOrder
from softclose.waveform import AnyDrive, Delivered
from softclose.waveform.lowpass import room
from softclose.waveform.scales import Scales

MAX_STEPS = 200_000
"""Work limit per switch [integration steps]: a thousand times what an ordinary trajectory needs."""

METHODS = ("taylor", "rk")


@dataclass(frozen=True, slots=True, kw_only=True)
class KernelOutput:
    """What a kernel writes, one entry per switch."""

    metrics: FloatArray
    """(5, n): largest contact speed, first contact, settling, final x, final v."""
    n_impacts: NDArray[np.int32]
    closed: NDArray[np.bool_]
    status: NDArray[np.int8]
    impact_time: FloatArray
    impact_speed: FloatArray
    x: NDArray[Any]
    v: NDArray[Any]
    mode_x: NDArray[Any] | None = None
    """(n, n_modes - 1, n_times) parts of the further modes in x; None where they are not wanted."""
    mode_v: NDArray[Any] | None = None
    peaks: FloatArray | None = None
    """(n, n_modes) largest displacement by each mode until the first impact [µm]."""


def devices(switches: FloatArray, plate_area_um2: float) -> FloatArray:
    """(n, 4) travel D, gap G [µm], c [µm³/(µs² V²)] and k [1/µs²] of Eq. 1 per mass."""
    out = np.empty((len(switches), 4))
    out[:, :2] = switches[:, :2]
    out[:, 2] = EPSILON_0 * 1e6 * plate_area_um2 / (2000.0 * switches[:, 3])
    out[:, 3] = switches[:, 2] / (1000.0 * switches[:, 3])
    return out


def columns(
    switches: FloatArray,
    plate_area_um2: float,
    restitution: float | FloatArray,
    losses: Losses,
    v_stick: float = V_STICK,
    scales: Scales | None = None,
) -> FloatArray:
    """(n, 9): `devices`, restitution, per mass the damping rate [1/µs], film [µm³/µs], adhesion [µm/µs²]; v_stick.

    Where drives are scaled, those of the switch that moves alike, its times scaled, under the drive that is not: of
    t = b s and u(t) = a u0(s) follows x'' = (a b)² c (...) - b² k x - b d x' - ... in s.
    """
    out = np.empty((len(switches), 9))
    out[:, :4] = devices(switches, plate_area_um2)
    out[:, 4] = restitution
    out[:, 5] = np.sqrt(out[:, 3]) * losses.damping_ratio
    out[:, 6] = losses.film(plate_area_um2) / switches[:, 3]
    out[:, 7] = 1e-3 * losses.adhesion_uN / switches[:, 3]
    out[:, 8] = v_stick
    if scales is not None:
        a, b = scales.volts, scales.times
        out[:, 2:] *= np.stack([(a * b) ** 2, b**2, np.ones(len(b)), b, b, b**2, b], axis=1)
    return out


def shaped_columns(
    switches: FloatArray,
    plate_area_um2: float,
    restitution: float | FloatArray,
    losses: Losses,
    modes: ReducedOrder,
    v_stick: float,
    scales: Scales | None,
) -> FloatArray:
    """(n, 13): `columns`, and cubic stiffness per mass [1/(µm² µs²)], dielectric [µm], slip, and displacements of the
    table of capacitance over those of the switch; with a table, c is what its slopes [fF/µm] are multiplied by."""
    out = np.empty((len(switches), 13))
    out[:, :9] = columns(switches, plate_area_um2, restitution, losses, v_stick, scales)
    out[:, 12] = modes.capacitance.gap_um / switches[:, 1] if modes.capacitance else 1.0
    if modes.capacitance is not None:
        out[:, 2] = 0.5e-6 * out[:, 12] ** 2 / switches[:, 3]
        out[:, 2] *= 1.0 if scales is None else (scales.volts * scales.times) ** 2
    ratios = modes.ratios()[0]
    own = np.sqrt(1e-3 * switches[:, 2] / switches[:, 3]) * ratios[2]
    damping = np.broadcast_to(np.asarray(losses.damping_ratio), (len(switches),))
    out[:, 5] = np.where(damping > 0.0, out[:, 5], own if scales is None else own * scales.times)
    out[:, 9] = out[:, 3] * ratios[5]
    out[:, 10] = modes.dielectric.gap_um if modes.dielectric else 0.0
    out[:, 11] = SLIP * losses.free_path_um**SLIP_EXPONENT if losses.slips else 0.0
    return out


def pairs(
    switches: FloatArray,
    plate_area_um2: float,
    restitution: float | FloatArray,
    losses: Losses,
    modes: ReducedOrder,
    v_stick: float,
    scales: Scales | None,
) -> FloatArray:
    """(n, 17): the columns of `two_modes.run_block`. Scaled as in `columns`."""
    ratios = modes.ratios()
    first_k = 1e-3 * switches[:, 2] / switches[:, 3]
    out = np.empty((len(switches), two_modes.N_COLUMNS))
    out[:, :2] = switches[:, :2]
    out[:, 2], out[:, 3] = restitution, v_stick
    out[:, 4] = 1e-3 * losses.adhesion_uN
    out[:, 5] = 0.5e3 * EPSILON_0 * plate_area_um2
    out[:, 6] = losses.film(plate_area_um2)
    out[:, 7:9] = switches[:, 3:] * ratios[:, 0]
    out[:, 9:11] = first_k[:, None] * ratios[:, 1]
    damping = np.broadcast_to(np.asarray(losses.damping_ratio), (len(switches),))[:, None]
    out[:, 11:13] = np.sqrt(out[:, 9:11]) * np.where(damping > 0.0, damping, ratios[:, 2])
    out[:, 13:15], out[:, 15:17] = ratios[:, 3], ratios[:, 4]
    if scales is not None:
        a, b = scales.volts, scales.times
        out[:, 3:7] *= np.stack([b, b**2, (a * b) ** 2, b], axis=1)
        out[:, 9:13] *= np.stack([b**2, b**2, b, b], axis=1)
    return out


def in_series(modes: ReducedOrder | None, losses: Losses) -> bool:
    """Whether a switch has a Taylor kernel.

    One mode (None, or one whose electrode is its contact), which may stretch, over a dielectric, behind a film that may
    slip, with a table of capacitances or a cubic of it; or two linear ones, plates, an electrode that is or is not the
    contact. Contacts are rigid.
    """
    if modes is None:
        return True
    if modes.contact is not None:
        return False
    if len(modes.mode) == 1:
        cells = modes.capacitance is None or len(modes.capacitance.slope()[1]) <= N_SLOPES
        return cells and modes.mode[0].electrode == modes.mode[0].contact
    if len(modes.mode) != two_modes.N_MODES or losses.slips or modes.dielectric is not None or modes.capacitance:
        return False
    if modes.ratios()[:, 5].any():
        return False
    (ca, ea), (cb, eb) = ((m.contact, m.electrode) for m in modes.mode)
    apart = abs(ea * cb - eb * ca) / (math.hypot(ca, cb) * math.hypot(ea, eb))
    return apart > _APART or apart < 0.1 * two_modes.TOGETHER


N_SLOPES = 3
"""Coefficients of dC/dx in a cell of a table, as the Taylor kernel has them."""


def _cells(modes: ReducedOrder | None) -> tuple[FloatArray, FloatArray]:
    """Knots and slopes of a table of capacitances; empty where there is none."""
    if modes is None or modes.capacitance is None:
        return np.zeros(0), np.zeros((N_SLOPES, 0))
    knots, slopes = modes.capacitance.slope()
    if slopes.shape[1] == 1:  # about 0, no cell's lower end
        about = np.poly1d(slopes[:, 0])(np.poly1d([1.0, knots[0]]))
        slopes = np.asarray(np.poly1d(about).coeffs)[:, None]
    padded = np.zeros((N_SLOPES, slopes.shape[1]))
    padded[N_SLOPES - len(slopes) :] = slopes
    return knots, padded


_APART = 1e-4
"""Sine of the angle between contact and electrode, as directions in the space of both modes, below which the
electrode hardly feels what is left of the motion of a held switch, and its series loses digits."""


def _modal_inputs(
    switches: FloatArray, plate_area_um2: float, losses: Losses, modes: ReducedOrder
) -> tuple[FloatArray, ...]:
    """Devices, contact, knots and slopes of `modal.run_block`."""
    table = np.empty((len(switches), 10))
    table[:, :2] = switches[:, :2]
    table[:, 2] = 0.5e3 * EPSILON_0 * plate_area_um2
    table[:, 3] = losses.film(plate_area_um2)
    table[:, 4] = 1e-3 * losses.adhesion_uN
    table[:, 5] = switches[:, 3]
    table[:, 6] = 1e-3 * switches[:, 2]
    table[:, 7] = modes.capacitance.gap_um / switches[:, 1] if modes.capacitance else 1.0
    table[:, 8] = modes.dielectric.gap_um if modes.dielectric else 0.0
    table[:, 9] = losses.free_path_um
    c = modes.contact  # (4,) stiffness [mN/µm^exponent], exponent, loss, dashpot [mN µs/µm]; no stiffness: rigid
    contact = np.zeros(4)
    if c is not None:
        contact[:] = 1e-3 * c.force_at_1_um_uN, c.exponent, c.loss_us_per_um, 1e-3 * c.dashpot_uN_s_per_m
    knots, slopes = modes.capacitance.slope() if modes.capacitance else (np.zeros(0), np.zeros((1, 0)))
    return table, contact, knots, slopes


_NO_ROOM = (np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros((0, 0, 4)))


def _ways(drive: AnyDrive, horizon_us: float, scales: Scales | None) -> tuple[int, tuple[Any, ...], tuple[Any, ...]]:
    """Form and flat form of a drive, and the path and scales of `taylor.run_block`."""
    if not isinstance(drive, Delivered):
        flat = drive_pieces.flatten(drive, horizon_us)
        return flat[2].shape[2], flat, (np.zeros(0), np.ones((1, 3)))
    rows = np.array([[1.0, drive.delay_us, drive.offset_volts]])
    if scales is not None and ((scales.times != 1.0).any() or drive.offset_volts != 0.0):
        # In the times and volts of the command, which c and k account for, it is the way that differs.
        rows = np.stack([scales.times, drive.delay_us / scales.times, drive.offset_volts / scales.volts], axis=1)
    return drive_pieces.DECAYING, drive.flat_command(horizon_us), (drive.path(horizon_us), rows)


def _samples(x: NDArray[Any], v: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """x and v in float64, and in float32, of which one pair is empty."""
    unused = np.empty((1, 0), dtype=np.float32 if x.dtype == np.float64 else np.float64)
    return (x, v, unused, unused) if x.dtype == np.float64 else (unused, unused, x, v)


def _further(out: KernelOutput, n_modes: int, wanted: bool) -> tuple[NDArray[Any], NDArray[Any]]:
    """Room for the parts of the further modes in x and v; without instants where they are not wanted."""
    n_rows, n_times = out.x.shape if wanted else (1, 0)
    shape = (n_rows, n_modes - 1, n_times)
    return np.empty(shape, dtype=out.x.dtype), np.empty(shape, dtype=out.x.dtype)


def _kept(mode_x: NDArray[Any], mode_v: NDArray[Any], wanted: bool) -> dict[str, Any]:
    return {"mode_x": mode_x, "mode_v": mode_v} if wanted else {}


def run(
    switches: FloatArray,
    drive: AnyDrive,
    *,
    horizon_us: float,
    restitution: float | FloatArray,
    plate_area_um2: float,
    rtol: float,
    times_us: FloatArray,
    method: str,
    threads: int,
    max_impacts: int,
    dtype: type[Any],
    v_stick: float,
    max_steps: int,
    losses: Losses,
    modes: ReducedOrder | None,
    scales: Scales | None,
    further_modes: bool = False,
) -> KernelOutput:
    """Integrate every switch. Inputs are valid already (`device.simulate`). Each switch is computed on its own.

    With scales, times and speeds of the output are those of the scaled switches (`columns`).
    """
    n = len(switches)
    # An output that is not wanted is one empty row: every call has the same types, so nothing is compiled again.
    n_rows, n_events = (n if len(times_us) else 1), (n if max_impacts else 1)
    out = KernelOutput(
        metrics=np.full((5, n), np.nan),
        n_impacts=np.zeros(n, dtype=np.int32),
        closed=np.zeros(n, dtype=np.bool_),
        status=np.zeros(n, dtype=np.int8),
        impact_time=np.full((n_events, max_impacts), np.nan),
        impact_speed=np.full((n_events, max_impacts), np.nan),
        x=np.empty((n_rows, len(times_us)), dtype=dtype),
        v=np.empty((n_rows, len(times_us)), dtype=dtype),
    )
    settings = (rtol, max_steps)
    events = (out.metrics, out.n_impacts, out.closed, out.status, out.impact_time, out.impact_speed)
    work: Callable[[int, int], None]
    shaped = losses.slips if modes is None else len(modes.mode) == 1
    series = method == "taylor" and in_series(modes, losses)
    if series and not shaped and modes is not None:
        peaks = np.empty((n, two_modes.N_MODES))
        mode_x, mode_v = _further(out, two_modes.N_MODES, further_modes)
        out = replace(out, peaks=peaks, **_kept(mode_x, mode_v, further_modes))
        table = pairs(switches, plate_area_um2, restitution, losses, modes, v_stick, scales)
        form, flat, way = _ways(drive, horizon_us, scales)
        block = two_modes.block(form=form, film=bool(np.any(losses.film_viscosity_uPa_s)))
        samples = (*_samples(out.x, out.v), *_samples(mode_x[:, 0], mode_v[:, 0]))

        def work(lo: int, hi: int) -> None:
            scratch = room(flat[0], flat[2]) if form == drive_pieces.DECAYING else _NO_ROOM
            block(lo, hi, table, *flat, *way, *scratch, *settings, times_us, *events, *samples, peaks)

    elif not series and (modes is not None or not losses.none):
        from softclose.kernel import modal

        modes = modes or ONE_MODE
        peaks = np.empty((n, len(modes.mode)))
        wanted = further_modes and len(modes.mode) > 1
        motion = _further(out, len(modes.mode), wanted)
        out = replace(out, peaks=peaks, **_kept(*motion, wanted))
        block = modal.block(len(modes.mode))
        table, *shared = _modal_inputs(switches, plate_area_um2, losses, modes)
        ratios, damping, eta = modes.ratios(), losses.damping_ratio, restitution
        flat = drive_pieces.flatten(drive, horizon_us)

        def rows(lo: int, hi: int, lost: Any, rebound: Any) -> None:
            own = ratios.copy()
            if lost > 0.0:
                own[:, 2] = lost
            samples = (out.x, out.v, *motion)
            block(lo, hi, table, own, *shared, *flat, rebound, v_stick, *settings, times_us, *events, *samples, peaks)

        def work(lo: int, hi: int) -> None:
            if np.ndim(damping) == np.ndim(eta) == 0:
                return rows(lo, hi, damping, eta)
            lost, rebound = np.broadcast_to(damping, (n,)), np.broadcast_to(eta, (n,))
            for i in range(lo, hi):
                rows(i, i + 1, lost[i], rebound[i])
            return None

    elif method == "taylor":
        if shaped:
            table = shaped_columns(switches, plate_area_um2, restitution, losses, modes or ONE_MODE, v_stick, scales)
        else:
            table = columns(switches, plate_area_um2, restitution, losses, v_stick, scales)
        film = bool(np.any(losses.film_viscosity_uPa_s))
        form, flat, way = _ways(drive, horizon_us, scales)
        knots, slopes = _cells(modes)
        block = taylor.block(form=form, lossy=shaped or losses.moving, film=film, shaped=shaped, table=bool(len(knots)))
        samples = _samples(out.x, out.v)
        peaks = np.empty((n if shaped else 1, 1))
        if modes is not None:
            out = replace(out, peaks=peaks)

        def work(lo: int, hi: int) -> None:
            scratch = room(flat[0], flat[2]) if form == drive_pieces.DECAYING else _NO_ROOM
            block(
                lo,
                hi,
                table,
                knots,
                slopes,
                np.empty((3, MAX_RETURNS)),
                *flat,
                *way,
                *scratch,
                *settings,
                times_us,
                *events,
                *samples,
                peaks,
            )

    else:
        table = columns(switches, plate_area_um2, restitution, losses)
        flat = drive_pieces.flatten(drive, horizon_us)

        def work(lo: int, hi: int) -> None:
            rk.run_block(lo, hi, table, *flat, v_stick, *settings, times_us, *events, out.x, out.v)

    threads = min(threads, n)
    if threads <= 1:
        work(0, n)
        return out
    edges = [n * i // threads for i in range(threads + 1)]
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, edges[:-1], edges[1:]))
    return out
