"""Owns the figure of a calibration, after the published Fig. 3: histogram and fitted density of E, G, T and D."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from softclose.population import UNITS
from softclose.population.calibrate import KINDS, Calibration
from softclose.population.measurements import MeasurementError


def draw(calibration: Calibration, path: str | Path) -> None:
    """Write the four panels. Raises MeasurementError where the file cannot be written."""
    import matplotlib  # here: it is slow to import
    from matplotlib.figure import Figure

    style: Any = {"svg.hashsalt": "softclose", "font.size": 9, "axes.spines.top": False, "axes.spines.right": False}
    panels = calibration.panels()
    with matplotlib.rc_context(style):
        figure = Figure(figsize=(8, 5.4), layout="constrained")
        for axes, v in zip(figure.subplots(2, 2).flat, "EGTD", strict=True):
            p = panels[v]
            axes.stairs(p["density"], p["edges"], fill=True, color="#1f5a94", alpha=0.3)
            axes.plot(p["grid"], p["fitted"], color="#1f5a94")
            axes.set_xlabel(f"{v} [{UNITS[v]}], {KINDS[v]}, p = {calibration.fits[v].p_value:.2f}")
            axes.set_ylabel("density")
        try:
            figure.savefig(path, metadata={"Date": None} if Path(path).suffix == ".svg" else None)
        except (OSError, ValueError) as e:
            raise MeasurementError(f"the figure cannot be written to {path}: {e}") from e
