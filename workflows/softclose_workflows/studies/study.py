"""Owns studies: one campaign per value of a parameter, certified, and every optimum tried under every other value.

The folder holds a store per value; the same call continues after a stop and computes only what is missing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from softclose.arrays import FloatArray
from softclose.waveform import is_above
from softclose_workflows.analyses.certify import Certification, assess_fresh, simulate_fresh
from softclose_workflows.run.crew import open_crew
from softclose_workflows.studies.series import Effort, Member, run_series
from softclose_workflows.studies.study_file import Study
from softclose_workflows.tell.console import bar, wide_console
from softclose_workflows.tell.labels import signed
from softclose_workflows.tell.outputs import write_text
from softclose_workflows.tell.plain import finite, json_text, waveform_rows
from softclose_workflows.tell.tables import describe_waveform, share_open, with_interval
from softclose_workflows.terminal import READING, working


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyResult:
    """What a study found."""

    study: Study
    """What was asked."""
    members: tuple[Member, ...]
    """One campaign per value."""
    certifications: tuple[Certification, ...]
    """Their certifications."""
    cross_g_cm_s: FloatArray
    """(n_value, n_value) certified g under value i of the optimum found under value j [cm/s]; NaN: not admissible."""

    @property
    def regret_cm_s(self) -> FloatArray:
        """g lost under value i by keeping the optimum of value j [cm/s]: near 0 where the optimum does not move."""
        return self.cross_g_cm_s - np.diag(self.cross_g_cm_s)[:, None]

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        plain: dict[str, Any] = finite(
            {
                "name": self.study.name,
                "title": self.study.title,
                "parameter": self.study.parameter,
                "unit": self.study.unit,
                "values": [
                    {
                        "value": value,
                        "store": f"{member.name}.zarr",
                        "candidate": c.best.candidate,
                        "waveform": waveform_rows(c.best.waveform.rows()),
                        "optimism_cm_s": c.best.optimism_cm_s,
                        **c.best.assessment.to_dict(),
                        "references": {r.name: r.assessment.to_dict() for r in c.references},
                    }
                    for value, member, c in zip(self.study.values, self.members, self.certifications, strict=True)
                ],
                "cross_g_cm_s": self.cross_g_cm_s.tolist(),
                "regret_cm_s": self.regret_cm_s.tolist(),
            }
        )
        return plain


def run_study(study: Study, folder: str | Path, effort: Effort) -> StudyResult:
    """Run, continue or re-read a study, and write `study.json` into its folder."""
    with working(READING, quiet=effort.quiet):
        members = study.members()
    certifications = run_series(members, folder, effort)
    result = StudyResult(
        study=study,
        members=tuple(members),
        certifications=tuple(certifications),
        cross_g_cm_s=cross_evaluate(members, certifications, effort),
    )
    write_text(Path(folder) / "study.json", json_text(result.to_json(), indent=1) + "\n", "--out")
    return result


def cross_evaluate(members: Sequence[Member], certifications: Sequence[Certification], effort: Effort) -> FloatArray:
    """Certified g of every optimum under every value, on the new switches of that value. (n_value, n_value)."""
    g = np.full((len(members), len(members)), math.nan)
    waveforms = [c.best.waveform for c in certifications]
    with (
        bar("every optimum under every value", quiet=effort.quiet) as listener,
        open_crew(effort.placement) as crew,
    ):
        for i, (member, own) in enumerate(zip(members, certifications, strict=True)):
            config = member.config
            columns = [
                j
                for j, waveform in enumerate(waveforms)
                if j != i and not is_above(waveform.max_voltage(config.model.horizon_us), config.waveform.max_volts)
            ]
            g[i, i] = own.best.assessment.g_cm_s
            responses = simulate_fresh(
                config,
                [waveforms[j] for j in columns],
                n_switches=own.n_switches,
                seed=own.seed,
                mapper=crew,
                listener=listener,
            )
            for j, response in zip(columns, responses, strict=True):
                g[i, j] = assess_fresh(response, config).g_cm_s
    return g


def print_study(result: StudyResult) -> None:
    """A row per value, and what keeping each optimum would cost under the others."""
    from rich.table import Table

    study, console = result.study, wide_console()
    table = Table(title=study.title, title_justify="left", show_lines=True)
    table.add_column(f"{study.parameter}{f' [{study.unit}]' if study.unit else ''}", justify="right")
    table.add_column("waveform")
    for column in ("v_u [cm/s]", "mean V [cm/s]", "left open", "g [cm/s]", "optimism", "unshaped v_u"):
        table.add_column(column, justify="right", no_wrap=True)
    for value, c in zip(study.values, result.certifications, strict=True):
        a = c.best.assessment
        table.add_row(
            f"{value:g}",
            describe_waveform(waveform_rows(c.best.waveform.rows())),
            with_interval(a.v_u_cm_s, *a.v_u_interval),
            with_interval(a.mean_cm_s, *a.mean_interval),
            share_open(a.p_nc, a.p_nc_intervals.wilson, a.n_failed),
            with_interval(a.g_cm_s, *a.g_interval),
            signed(c.best.optimism_cm_s, 2),
            f"{c.references[0].assessment.v_u_cm_s:.2f}",
        )
    console.print(table)
    cross = Table(title="g lost by keeping the optimum of another value [cm/s]", title_justify="left")
    cross.add_column("under")
    for value in study.values:
        cross.add_column(f"optimum of {value:g}", justify="right")
    for value, row in zip(study.values, result.regret_cm_s, strict=True):
        cross.add_row(f"{value:g}", *("not admissible" if math.isnan(r) else signed(r, 2) for r in row))
    console.print(cross)
