"""Owns what the surrogate sees beyond the coordinates: the names of its further inputs, and what they are."""

from __future__ import annotations

SWING: dict[str, str] = {
    "reach": "reach of the free swing",
    "dispersion": "scatter of the lot",
    "x_last": "position at the last pulse",
    "v_last": "velocity at the last pulse",
}
"""Name -> words, in the order of `surrogate.surrogate_inputs`; the store keeps a length scale of each by its name."""
