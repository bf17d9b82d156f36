"""Owns the drift of a stored design's lot: on the certification's new switches, told as a table or as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from softclose.device.told import mean_switch
from softclose.evaluate.chain import chain_of
from softclose.evaluate.pieces import Mapper, here
from softclose.settings import CampaignConfig
from softclose.uncertainty.drift import Drift, DriftError, DriftKind
from softclose.uncertainty.drift import drift as assess_drift
from softclose_workflows.analyses.certify import fresh_switches
from softclose_workflows.analyses.chosen import Chosen, choose
from softclose_workflows.run.needs import check_fresh
from softclose_workflows.tell.console import OnStep, wide_console
from softclose_workflows.tell.labels import in_percent
from softclose_workflows.tell.plain import finite
from softclose_workflows.tell.tables import points, share_open, with_interval

USUAL = (-0.2, -0.1, -0.05, -0.02, -0.01, 0.01, 0.02, 0.05, 0.1, 0.2)
"""Drifts that are looked at where none is named, as parts of the pull-in voltage."""
MOST_OPEN = 0.5
"""Share of open switches beyond which v_u is of a minority, and its doubling no news."""


def usual(config: CampaignConfig, kind: DriftKind) -> tuple[float, ...]:
    """Drifts to look at: parts of the mean switch's pull-in voltage, in the device model; of charge in volts [V]."""
    if kind == "stiffness":
        return USUAL
    device = chain_of(config).device
    volts = float(device.closing_voltage(mean_switch(config.build_population(), device))[0])
    if not math.isfinite(volts):
        raise DriftError("the lot has no pull-in voltage to take drifts from: name them (--at)")
    return tuple(float(f"{part * volts:.2g}") for part in USUAL)


def drift(
    path: str,
    kind: DriftKind,
    values: Sequence[float] = (),
    *,
    candidate: int | None = None,
    n_switches: int = 20_000,
    mapper: Mapper = here,
    listener: OnStep | None = None,
) -> tuple[Chosen, Drift]:
    """A stored waveform over a range of drifts. Raises DriftError and CertifyError."""
    check_fresh(n_switches, 1)
    chosen = choose(path, candidate)
    switches = fresh_switches(chosen.config, n_switches, seed=chosen.seed)
    wanted = values or usual(chosen.config, kind)
    return chosen, assess_drift(
        chosen.config, switches, chosen.waveform, kind, wanted, mapper=mapper, listener=listener
    )


def shown(kind: DriftKind, value: float) -> str:
    """`+2 %`, `−1.5 V`."""
    said = f"{100.0 * value:+.3g} %" if kind == "stiffness" else f"{value:+.3g} V"
    return said.replace("-", "−")


def sentences(found: Drift) -> list[str]:
    """Where v_u has doubled, on either side."""
    said = []
    for value, side in zip(found.doubled, (found.rows[0].drift, found.rows[-1].drift), strict=True):
        if side == 0.0:
            continue
        last = next(r.assessment for r in found.rows if r.drift == side)
        if math.isinf(value) and not last.p_nc <= MOST_OPEN:
            few = "all" if last.p_nc == 1.0 else f"{in_percent(last.p_nc, 1)} of the"
            said.append(f"at {shown(found.kind, side)} {few} switches stay open: v_u is none of the lot there")
        elif math.isinf(value):
            said.append(f"v_u has not doubled at {shown(found.kind, side)}")
        else:
            said.append(f"v_u has doubled at {shown(found.kind, value)}")
    return said


def print_drift(chosen: Chosen, found: Drift, n_switches: int) -> None:
    """One row a drift, with intervals; then where v_u has doubled."""
    from rich.table import Table

    table = Table(
        title=f"candidate {chosen.candidate} ({chosen.why}), pull-in voltages drifting by {found.kind}, on "
        f"{n_switches:,} new switches",
        title_justify="left",
    )
    table.add_column("drift", justify="right", no_wrap=True)
    for column in ("v_u [cm/s]", "change", "left open", "change", "g [cm/s]"):
        table.add_column(column, justify="right", no_wrap=True)
    for r in found.rows:
        a, c = r.assessment, r.comparison
        still = r.drift == 0.0
        table.add_row(
            "none" if still else shown(found.kind, r.drift),
            with_interval(a.v_u_cm_s, *a.v_u_interval),
            "" if still else with_interval(c.v_u_cm_s, *c.v_u_interval),
            share_open(a.p_nc, a.p_nc_intervals.wilson, a.n_failed),
            "" if still else points(c.p_nc, *c.p_nc_interval),
            f"{a.g_cm_s:.2f}",
        )
    console = wide_console()
    console.print(table)
    for sentence in sentences(found):
        console.print(sentence)


def to_json(chosen: Chosen, found: Drift) -> dict[str, Any]:
    """Plain values."""
    plain: dict[str, Any] = finite(
        {
            "candidate": chosen.candidate,
            "kind": found.kind,
            "said": sentences(found),
            "doubled": [None if math.isinf(v) else v for v in found.doubled],
            "rows": [
                {"drift": r.drift, "change": r.comparison.to_dict(), **r.assessment.to_dict()} for r in found.rows
            ],
        }
    )
    return plain
