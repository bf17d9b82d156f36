"""Owns the choice between a drive's exact pieces and fewer polynomials that have their area."""

from __future__ import annotations

import numpy as np

from softclose.arrays import FloatArray, IntArray
from softclose.waveform.delivered import Delivered
from softclose.waveform.fitted import MANY, TOLERANCE_VOLT_US, Cells, Fitted
from softclose.waveform.flat import volts
from softclose.waveform.pieced import Pieced


def fewest(drive: Pieced | Delivered, horizon_us: float, step_us: float) -> Pieced | Delivered | Fitted:
    """The drive itself, or polynomials where they are half as many.

    step_us: longest part of a curved piece that is taken for a parabola [µs].
    """
    flat = drive.flat(horizon_us)
    pieces, n_ramps, _ = flat
    if len(pieces) <= MANY:
        return drive
    parts = np.where(n_ramps > 0, np.ceil((pieces[:, 1] - pieces[:, 0]) / step_us), 1.0).astype(np.int64)
    fitted = Fitted.of_cells(_cells(*flat, parts), TOLERANCE_VOLT_US)
    return fitted if 2 * len(fitted.coefficients) <= len(pieces) else drive


def _cells(pieces: FloatArray, n_ramps: IntArray, ramps: FloatArray, parts: IntArray) -> Cells:
    """So many parabolas a piece; what is exactly at an end belongs to the piece."""
    which = np.repeat(np.arange(len(pieces)), parts)
    nth = np.arange(len(which)) - np.repeat(np.cumsum(parts) - parts, parts)
    width = (pieces[which, 1] - pieces[which, 0]) / parts[which]
    begins = pieces[which, 0] + nth * width
    at = np.stack([begins, begins + 0.5 * width, begins + width])
    first, middle, last = volts(pieces, n_ramps, ramps, np.broadcast_to(which, at.shape), at)
    return Cells(ends=np.append(begins, pieces[-1, 1]), first=first, middle=middle, last=last)
