"""Owns the reproduction of the published study: every case from its preset, certified, beside the printed figures.

The folder holds one store per campaign; the same call continues after a stop. `table.txt`, `table.json` and the figures
depend on the presets alone, so a second run writes the same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from softclose.metrics.objective import CM_S
from softclose.metrics.paired import spread_at
from softclose.settings import load_config
from softclose_workflows.analyses.certify import Certification
from softclose_workflows.studies.published import CASES, LIMIT_CM_S, N_PUBLISHED, presets
from softclose_workflows.studies.reproduced import ReproducedRow
from softclose_workflows.studies.series import Effort, Member, run_series
from softclose_workflows.tell.console import wide_console
from softclose_workflows.tell.labels import percent_interval, signed
from softclose_workflows.tell.outputs import check_folder, write_text
from softclose_workflows.tell.plain import finite, json_text, waveform_rows
from softclose_workflows.tell.tables import describe_waveform, share, with_interval
from softclose_workflows.terminal import READING, say, working

STORED = ("store.n_times=126",)
"""Trajectories every 2 µs: the figures simulate their own 200 switches, on a finer grid."""

QUICK = (
    "campaign.budget=24",
    "population.n_switches=200",
    "explore.budget=0",
    "finish.budget=0",
    "optimiser.n_initial=12",
)
"""Settings of --quick: minutes instead of a quarter of an hour, and worse optima."""

QUICK_SWITCHES = 10_000

WIDTH = 244
"""Columns that the table needs, so that none of its cells is cut."""

PUBLISHED_STEP = "reference.step_volts=100.0"
"""The published row is a step to 100 V, whatever limit a reproduction is asked for."""


def members(overrides: Sequence[str] = ()) -> list[Member]:
    """One campaign per preset."""
    settings = [*STORED, PUBLISHED_STEP, *overrides]
    return [Member(name=preset, config=load_config(preset, settings)) for preset in presets()]


def reproduce(folder: str | Path, effort: Effort, overrides: Sequence[str] = ()) -> list[ReproducedRow]:
    """Run, continue or re-read every campaign, and write the tables. Raises OutputError for a folder that cannot be."""
    folder = check_folder(folder)
    with working(READING, quiet=effort.quiet):
        campaigns = members(overrides)
    certifications = run_series(campaigns, folder / "stores", effort)
    rows = _rows(campaigns, certifications)
    write_text(folder / "table.json", json_text(to_json(rows), indent=1) + "\n", "--out")
    write_text(folder / "table.txt", to_text(rows), "--out")
    return rows


def _rows(campaigns: Sequence[Member], certifications: Sequence[Certification]) -> list[ReproducedRow]:
    by_name = {m.name: (m, c) for m, c in zip(campaigns, certifications, strict=True)}
    rows = []
    for case in CASES:
        member, certification = by_name[case.preset]
        designs = {"best": certification.best} | {r.name: r for r in certification.references}
        if case.design not in designs:
            why = certification.missing.get(case.design, "its certification is of an older version")
            say(f"note: {case.title}, {case.how}, is left out: {why}", err=True)
            continue
        certified = designs[case.design]
        v = certified.response.max_contact_speed * CM_S
        ordered = np.sort(v[~np.isnan(v)])
        half = 1.96 * float(ordered.std()) / math.sqrt(N_PUBLISHED) if ordered.size else math.nan
        mean = certified.assessment.mean_cm_s
        rows.append(
            ReproducedRow(
                case=case,
                config=member.config,
                store=member.name,
                certified=certified,
                mean_range=(mean - half, mean + half),
                v_u_range=spread_at(ordered, certified.assessment.level, N_PUBLISHED),
            )
        )
    return rows


def to_json(rows: Sequence[ReproducedRow]) -> dict[str, Any]:
    """Plain values of the whole comparison."""
    plain: dict[str, Any] = finite(
        {
            "n_fresh_switches": rows[0].certified.assessment.n,
            "n_published_switches": N_PUBLISHED,
            "cases": [
                {
                    "title": r.case.title,
                    "how": r.case.how,
                    "store": f"stores/{r.store}.zarr",
                    "design": r.certified.name,
                    "published": None
                    if r.case.published is None
                    else {
                        "v_u_cm_s": r.case.published.v_u_cm_s,
                        "mean_cm_s": r.case.published.mean_cm_s,
                        "p_exceed": r.case.published.p_exceed,
                    },
                    "verdict": r.verdict,
                    "v_u_range_of_200_cm_s": r.v_u_range,
                    "mean_range_of_200_cm_s": r.mean_range,
                    "optimism_cm_s": r.certified.optimism_cm_s,
                    "n_training_switches": r.certified.training.n_switches if r.certified.training else None,
                    "waveform": waveform_rows(r.certified.waveform.rows()),
                    **r.certified.assessment.to_dict(),
                }
                for r in rows
            ],
        }
    )
    return plain


def to_text(rows: Sequence[ReproducedRow]) -> str:
    """The comparison as a plain text table, then the waveforms."""
    from io import StringIO

    from softclose_workflows.terminal import plain_console

    out = StringIO()
    console = plain_console(file=out, width=WIDTH, color_system=None)
    _print(console, rows)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def print_reproduction(rows: Sequence[ReproducedRow]) -> None:
    """The comparison for people."""
    _print(wide_console(), rows)


def _print(console: Any, rows: Sequence[ReproducedRow]) -> None:
    from rich.table import Table

    n = rows[0].certified.assessment.n
    table = Table(
        title=f"Published figures (N = {N_PUBLISHED}) beside ours, certified on {n:,} new switches [cm/s]",
        title_justify="left",
    )
    table.add_column("case", no_wrap=True)
    table.add_column("found by", no_wrap=True)
    for column in (
        "v_u\npublished",
        "v_u, ours\n(95 % interval)",
        "v_u at N = 200,\n95 % of ensembles",
        "mean V\npublished",
        "mean V, ours\n(95 % interval)",
        f"P(V > {LIMIT_CM_S:g})\npublished",
        f"P(V > {LIMIT_CM_S:g}), ours\n(Eq. 11)",
        "left open",
        "g",
        "optimism",
        "",
    ):
        table.add_column(column, justify="right", no_wrap=True)
    for r in rows:
        a, p = r.certified.assessment, r.case.published
        exceed = next((e.probability for e in a.p_exceed if e.limit_cm_s == LIMIT_CM_S), None)
        table.add_row(
            r.case.title,
            r.case.how,
            "" if p is None else f"{p.v_u_cm_s:.1f}",
            with_interval(a.v_u_cm_s, *a.v_u_interval),
            f"{r.v_u_range[0]:.1f}–{r.v_u_range[1]:.1f}",
            "" if p is None else f"{p.mean_cm_s:.1f}",
            with_interval(a.mean_cm_s, *a.mean_interval),
            "" if p is None or p.p_exceed is None else percent_interval(*p.p_exceed, digits=0).replace("\u202f", " "),
            "" if exceed is None else share(exceed.estimate, *exceed.wald, 1),
            share(a.p_nc),
            f"{a.g_cm_s:.2f}",
            "" if math.isnan(r.certified.optimism_cm_s) else signed(r.certified.optimism_cm_s, 2),
            r.verdict,
        )
    console.print(table)
    console.print(
        "v_u at N = 200: what ensembles as small as the published ones would say of our waveform; a published figure\n"
        "in that range agrees. optimism: certified g minus the g of the training ensemble. What differs, and why: "
        "docs/results/README.md\n"
    )
    for r in rows:
        console.print(f"{r.case.title}, {r.case.how}")
        for line in describe_waveform(waveform_rows(r.certified.waveform.rows())).splitlines():
            console.print(f"    {line}")
