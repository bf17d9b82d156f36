"""Owns the small picture of a drive: an SVG in the page's own colours that needs no script, on screen and on paper."""

from __future__ import annotations

import math
from html import escape

from softclose.waveform import Waveform
from softclose_workflows.report.packed import waveform_points

WIDTH, HEIGHT = 420, 150
_LEFT, _RIGHT, _TOP, _BOTTOM = 44, 408, 10, 118


def drive_picture(waveform: Waveform, horizon_us: float, limit_V: float) -> str:
    """The command over time, until a little after its last change, under the limit of the voltage.

    waveform: what is commanded. horizon_us: end of the simulation [µs]. limit_V: `waveform.max_volts` [V].
    """
    last = float(waveform.breakpoints(horizon_us)[-1])
    until = min(horizon_us, 10.0 * math.ceil((last + 20.0) / 10.0))
    times, volts = waveform_points(waveform, until)
    top = max(limit_V, float(volts.max(initial=0.0)))
    low = min(0.0, float(volts.min(initial=0.0)))

    def x(t: float) -> float:
        return _LEFT + (_RIGHT - _LEFT) * t / until

    def y(u: float) -> float:
        return _BOTTOM - (_BOTTOM - _TOP) * (u - low) / (top - low)

    points = " ".join(f"{x(t):.1f},{y(u):.1f}" for t, u in zip(times.tolist(), volts.tolist(), strict=True))
    step = _step(until)
    ticks = "".join(
        f'<line class="tick" x1="{x(t):.1f}" x2="{x(t):.1f}" y1="{_BOTTOM}" y2="{_BOTTOM + 4}"/>'
        f'<text class="mid" x="{x(t):.1f}" y="{_BOTTOM + 17}">{t:g}</text>'
        for t in (k * step for k in range(int(until / step) + 1))
    )
    levels = "".join(
        f'<line class="rule" x1="{_LEFT}" x2="{_RIGHT}" y1="{y(u):.1f}" y2="{y(u):.1f}"/>'
        f'<text class="end" x="{_LEFT - 6}" y="{y(u) + 4:.1f}">{u:g}</text>'
        for u in (0.0, limit_V)
    )
    said = escape(f"Drive voltage over {until:g} µs: from {volts.min():.1f} to {volts.max():.1f} V.", quote=True)
    return (
        f'<svg class="drive" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{said}">'
        f"{levels}{ticks}"
        f'<polyline points="{points}"/>'
        f'<text class="end" x="{_RIGHT}" y="{HEIGHT - 2}">Time (µs)</text>'
        f'<text class="mid" transform="translate(11 {(_TOP + _BOTTOM) / 2}) rotate(-90)">Voltage (V)</text></svg>'
    )


def _step(until: float) -> float:
    """Distance of the ticks: 1, 2 or 5 times a power of ten, four to nine of them."""
    for factor in (1.0, 2.0, 5.0, 10.0):
        step = factor * 10.0 ** math.floor(math.log10(until / 8.0))
        if until / step <= 9.0:
            return step
    return step
