"""Owns the figures of the reproduction, drawn after the published ones."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from softclose.metrics.objective import CM_S
from softclose_workflows.figures.drawing import LINES, draw_motion
from softclose_workflows.figures.saving import save
from softclose_workflows.figures.style import COLOURS, PAGE_IN, style
from softclose_workflows.tell.outputs import make_folder

if TYPE_CHECKING:
    from softclose.population import Population
    from softclose_workflows.studies.reproduced import ReproducedRow

N_DRAWN = 200
"""Switches whose trajectories a figure shows, as in the published ones."""

DRAWN_US = 120.0
"""How long they are drawn at least [µs]; a drive that still rises then is drawn until it holds."""

OURS, PRINTED = COLOURS["best"], COLOURS["deterministic"]


def draw_all(folder: Path, rows: Sequence[ReproducedRow]) -> list[Path]:
    """Write every figure into folder and return their paths."""
    make_folder(folder)
    with style():
        paths = [_comparison(folder, rows), _densities(folder, rows), _populations(folder, rows)]
        paths += [_response(folder, row) for row in rows if row.case.figure or "3 pulses" in row.case.title]
    return paths


def _save(figure: Figure, path: Path) -> Path:
    save(figure, path, "--out")
    return path


def _label(row: ReproducedRow) -> str:
    return f"{row.case.title} ({row.case.how})"


def _comparison(folder: Path, rows: Sequence[ReproducedRow]) -> Path:
    """Published v_u against ours, and what 200 switches would show of ours."""
    figure = Figure(figsize=(PAGE_IN, 0.38 * len(rows) + 1.2))
    axes = figure.subplots()
    for y, row in enumerate(rows):
        a = row.certified.assessment
        axes.plot(row.v_u_range, (y, y), color=OURS, lw=5, alpha=0.3, solid_capstyle="butt")
        axes.plot(a.v_u_cm_s, y, "o", color=OURS)
        if row.case.published is not None:
            axes.plot(row.case.published.v_u_cm_s, y, "D", color=PRINTED, mfc="none")
    axes.plot([], [], "o", color=OURS, label="ours, certified")
    axes.plot([], [], color=OURS, lw=5, alpha=0.3, label="ours, 95 % of ensembles of 200 switches")
    axes.plot([], [], "D", color=PRINTED, mfc="none", label="published (N = 200)")
    axes.set_yticks(range(len(rows)), [_label(row) for row in rows])
    axes.invert_yaxis()
    axes.set_xlim(left=0)
    axes.set_xlabel("upper velocity v_u [cm/s]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return _save(figure, folder / "comparison.svg")


def _densities(folder: Path, rows: Sequence[ReproducedRow]) -> Path:
    """Densities of V, after the published Fig. 13, from every certified switch."""
    figure = Figure(figsize=(PAGE_IN, 3.6))
    axes = figure.subplots()
    edges = np.arange(0.0, 60.5, 0.5)
    drawn = 0
    for row in rows:
        wanted = row.case.design == "deterministic" or (row.case.how == "softclose" and row.case.published is not None)
        if not wanted:
            continue
        v = row.certified.response.max_contact_speed * CM_S
        density, _ = np.histogram(v[~np.isnan(v)], bins=edges, density=True)
        axes.stairs(density, edges, label=_label(row), lw=1.4, linestyle=LINES[drawn % len(LINES)])
        drawn += 1
    axes.set_xlabel("largest contact speed V [cm/s]")
    axes.set_ylabel("probability density [s/cm]")
    axes.legend(fontsize=8)
    return _save(figure, folder / "densities.svg")


def _populations(folder: Path, rows: Sequence[ReproducedRow]) -> Path:
    """Densities of D, G, E, T and 1,000 samples of K and M, after the published Figs. 3 and 4."""
    from softclose.population import UNITS, VARIABLES

    configs: dict[str, Population] = {}
    for row in rows:
        population = row.config.build_population()
        configs.setdefault(population.name, population)
    figure = Figure(figsize=(PAGE_IN, 4.3))
    axes = figure.subplots(2, 3)
    for place, (name, population) in enumerate(configs.items()):
        line = LINES[place % len(LINES)]
        for axis, v in zip(axes.flat, VARIABLES, strict=False):
            b = getattr(population, v)
            x = np.linspace(b.lower, b.upper, 200)
            axis.plot(x, b.density(x), label=name, linestyle=line)
            axis.set_xlabel(f"{v} [{UNITS[v]}]")
            axis.set_ylabel(f"density [1/{UNITS[v]}]")
        switches = population.sample(1000, seed=1)
        for axis, column, label, density in ((axes[1, 1], 2, "K [N/m]", "m/N"), (axes[1, 2], 3, "M [µg]", "1/µg")):
            axis.hist(switches[:, column], bins=15, density=True, histtype="step", linestyle=line)
            axis.set_xlabel(label)
            axis.set_ylabel(f"density [{density}]")
    for axis in axes.flat:
        axis.set_ylim(bottom=0.0)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=len(configs))
    return _save(figure, folder / "populations.svg")


def _response(folder: Path, row: ReproducedRow) -> Path:
    """Waveform, displacement and velocity of 200 switches, and the histogram of V (Figs. 6 to 12)."""
    from softclose.evaluate import respond
    from softclose_workflows.analyses.certify import fresh_switches

    config, waveform = row.config, row.certified.waveform
    switches = fresh_switches(config, N_DRAWN, seed=config.campaign.seed)
    until = math.ceil(max(DRAWN_US, *waveform.breakpoints(config.model.horizon_us)))
    t = np.linspace(0.0, until, 4 * until + 1)
    r = respond(config, switches, waveform, times_us=t, dtype=np.float32)
    assert r.x is not None
    assert r.v is not None
    figure = Figure(figsize=(PAGE_IN, 5.2))
    axes = figure.subplots(2, 2)
    numbers = f" (compare the published Figs. {row.case.figure})" if row.case.figure else ""
    figure.suptitle(f"{_label(row)}{numbers}")
    axes[0, 0].plot(t, waveform.voltage(t), color=OURS)
    axes[0, 0].set_ylabel("u [V]")
    for axis, values, label in (
        (axes[0, 1], r.x - switches["D"][:, None], "x − D [µm]"),
        (axes[1, 1], r.v * CM_S, "dx/dt [cm/s]"),
    ):
        draw_motion(axis, t, values, r.closed)
        axis.set_ylabel(label)
    if not r.closed.all():
        axes[0, 1].plot([], [], "--", color=COLOURS["open"], lw=0.8, label="stays open")
        figure.legend(*axes[0, 1].get_legend_handles_labels(), loc="outside upper right")
    for axis in (axes[0, 0], axes[0, 1], axes[1, 1]):
        axis.set_xlabel("t [µs]")
        axis.set_xlim(0, t[-1])
    v = row.certified.response.max_contact_speed * CM_S
    axes[1, 0].hist(v[~np.isnan(v)], bins=np.arange(0.0, 60.5, 1.0), density=True, color=OURS, alpha=0.5)
    axes[1, 0].axvline(row.certified.assessment.v_u_cm_s, color=OURS, label="v_u, ours")
    if row.case.published is not None:
        axes[1, 0].axvline(row.case.published.v_u_cm_s, color=PRINTED, ls="--", label="v_u, published")
    axes[1, 0].set_xlabel("largest contact speed V [cm/s]")
    axes[1, 0].set_ylabel("density [s/cm]")
    axes[1, 0].legend(fontsize=8)
    name = re.sub(r"[^a-z0-9]+", "-", f"{row.case.preset} {row.case.design}".lower().removesuffix(" best"))
    return _save(figure, folder / f"{name}.png")
