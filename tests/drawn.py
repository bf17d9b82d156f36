"""Strategies of hypothesis that several tests draw from."""

from __future__ import annotations

import math

from hypothesis import strategies as st

from softclose import Pulse, Waveform


@st.composite
def pulses(draw: st.DrawFn) -> Waveform:
    """One to three, edges overlapping or not, ideal or not."""
    found = []
    for _ in range(draw(st.integers(1, 3))):
        rise = draw(st.one_of(st.just(0.0), st.floats(4.0, 20.0)))
        peak = draw(st.one_of(st.just(math.inf), st.floats(0.0, 30.0)))
        found.append(Pulse(draw(st.floats(0.0, 40.0)), rise, peak, draw(st.floats(20.0, 130.0))))
    return Waveform(found)
