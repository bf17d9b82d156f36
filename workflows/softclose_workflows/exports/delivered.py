"""Owns whether what is exported is still the waveform: v_u as the samples deliver it is computed before a file is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from softclose.arrays import FloatArray
from softclose.evaluate import judge
from softclose.metrics.objective import Assessment
from softclose.plugins import REDUCED_ORDER, SINGLE_MODE
from softclose.settings import CampaignConfig
from softclose.waveform import Drive, Trace, Waveform
from softclose_workflows.analyses.certify import simulate_fresh
from softclose_workflows.errors import ExportError
from softclose_workflows.tell.labels import in_percent

N_SWITCHES = 500
"""New switches on which waveform and samples are compared, the same for both: enough to tell 0.1 cm/s of them."""
MOST_SAMPLES = 50_000
"""Of more, every second, third … is taken, which is the harder test."""
LINES_V = 1e-3
"""Samples that lines through the others meet to this are left out: it moves V by less than 0.001 cm/s."""


def check_delivered(
    config: CampaignConfig, drive: Waveform, times_us: FloatArray, volts: FloatArray, *, most_cm_s: float
) -> None:
    """Refuse samples that no longer are the waveform.

    Drives of straight lines between the samples, the last voltage held, run beside the waveform on the same switches.
    A simulator of the user's own, or a bench, is not asked: there the voltage itself must be met, to 2 % of its peak.

    Parameters
    ----------
    config : CampaignConfig
        Lot, model and objective.
    drive : Waveform
        What was designed.
    times_us, volts : (n,) ndarray of float64
        The samples [µs, V], from 0 on.
    most_cm_s : float
        How far v_u may move [cm/s]; p_nc by a hundredth of it.

    Raises
    ------
    ExportError
        Saying by how much they differ.
    """
    apart_by = -(-times_us.size // MOST_SAMPLES)
    times_us, volts = (np.append(a[::apart_by], a[-1:] if (a.size - 1) % apart_by else []) for a in (times_us, volts))
    trace = Trace(times_us, volts) if times_us.size > 1 else Trace([0.0, 1.0], [volts[0], volts[0]])
    until = float(max(config.model.horizon_us, drive.breakpoints(np.inf)[-1] if drive.pulses else 0.0))
    grid = np.linspace(0.0, until, 5001)
    apart = float(np.abs(trace.voltage(grid) - drive.voltage(grid)).max())
    what = f"the samples end at {times_us[-1]:g} µs, and the drive is up to {apart:.4g} V away from the waveform"
    remedy = "raise the rate (--rate) or the duration (--duration), or say what is allowed (--max-error)"
    if config.model.name not in (SINGLE_MODE, REDUCED_ORDER):
        if apart > 0.02 * drive.max_voltage(until):
            raise ExportError(f"{what}: {remedy}")
        return
    ideal = replace(config, amplifier=type(config.amplifier)())
    drives: list[Drive] = [drive, trace.simplified(LINES_V)]
    found = simulate_fresh(ideal, drives, n_switches=N_SWITCHES, seed=config.campaign.seed, for_everybody=(0, 1))
    designed, delivered = (judge(ideal, response, fresh=True) for response in found)
    moved = abs(delivered.v_u_cm_s - designed.v_u_cm_s)
    opened = abs(delivered.p_nc - designed.p_nc)
    if not (moved <= most_cm_s and opened <= 0.01 * most_cm_s):
        raise ExportError(
            f"{what}: v_u would be {_speed(delivered)} in the place of {_speed(designed)}, and "
            f"{in_percent(delivered.p_nc, 1)} of the switches would stay open in the place of "
            f"{in_percent(designed.p_nc, 1)}; at most {most_cm_s:g} cm/s and {most_cm_s:g} points are allowed: {remedy}"
        )


def _speed(found: Assessment) -> str:
    """`25.44 cm/s`, or that there is none: where too few touch, nothing is softer."""
    return "undefined (too few switches touch)" if math.isnan(found.v_u_cm_s) else f"{found.v_u_cm_s:.2f} cm/s"
