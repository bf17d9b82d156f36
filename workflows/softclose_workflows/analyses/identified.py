"""Owns how a fit of dynamics is told: its parameters, what the readings leave open, what each reading says."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from softclose_workflows.tell.console import wide_console
from softclose_workflows.tell.labels import in_percent, signed
from softclose_workflows.tell.plain import finite

if TYPE_CHECKING:
    from softclose.identify.least_squares import Identified


def identified_to_json(found: Identified, files: Sequence[Path]) -> dict[str, Any]:
    """One object; an interval without an end has null there."""
    plain: dict[str, Any] = finite(
        {
            "parameters": {name: [told.value, *told.interval] for name, told in found.parameters.items()},
            "fixed": found.fixed,
            "untold": [each.powers for each in found.untold],
            "confidence": found.confidence,
            "misfit": found.misfit,
            "freedom": found.freedom,
            "force_error": found.force_error,
            "time_error": found.time_error,
            "readings": [
                {"kind": r.kind, "volts": r.volts, "device": r.device, "measured": r.value, "model": said}
                for r, said in zip(found.readings, found.said, strict=True)
            ],
            "devices": {name: factors.tolist() for name, factors in found.factors.items()},
            "files": [str(path) for path in files],
        }
    )
    return plain


def print_identified(found: Identified, files: Sequence[Path], said: Sequence[str]) -> None:
    """Tables for people."""
    from rich.table import Table

    from softclose.identify.model import PARAMETERS
    from softclose.identify.readings import UNITS

    console = wide_console()
    for line in said:
        console.print(line)
    table = Table(title=f"{files[0]}: the switch that these readings tell", title_justify="left")
    for column in ("", "meaning", f"value ({in_percent(found.confidence)} interval)"):
        table.add_column(column)
    for name, told in found.parameters.items():
        unit, meaning = PARAMETERS[name]
        low, high = told.interval
        interval = "not told" if math.isinf(high) else f"{low:.5g}–{high:.5g}"
        table.add_row(name, meaning, f"{told.value:.5g} ({interval}) {unit}".rstrip())
    for name, value in found.fixed.items():
        table.add_row(name, PARAMETERS[name][1], f"{value:.5g}, held {PARAMETERS[name][0]}".rstrip())
    console.print(table)
    if found.readings:
        rows = Table(title="Readings", title_justify="left")
        for column in ("reading", "device", "measured", "model", "off by"):
            rows.add_column(column, justify="left" if column in ("reading", "device") else "right")
        for r, value in zip(found.readings, found.said, strict=True):
            unit = UNITS[r.kind]
            off = f"{signed(100.0 * (value / r.value - 1.0))} %"
            rows.add_row(r.name, r.device, f"{r.value:.5g} {unit}".rstrip(), f"{value:.5g} {unit}".rstrip(), off)
        console.print(rows)
    for each in found.untold:
        console.print(f"note: {each}; fix one of them where you know it (--fix {next(iter(each.powers))}=VALUE)")
    if found.freedom <= 0:
        console.print("note: as many parameters as readings: intervals rest on the stated errors (--error) alone")
    elif found.misfit > 2.0:
        console.print(
            f"note: the model misses the readings by {found.misfit:.1f} of their stated errors; the table says which: "
            "the model lacks something that they show, or the errors are larger (--error)"
        )
    if found.agreeing < 0.5 * found.starts:
        console.print(
            f"note: {found.agreeing} of {found.starts} starts ended in the best fit; look for a better one (--starts)"
        )
    console.print(f"written: {', '.join(map(str, files))}; run it with `softclose run {files[0]}`")
