"""Owns how a certification is told: as tables for people, as one JSON object for scripts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from softclose.digits import digits_of, least_digits
from softclose.evaluate.quantities import Value, quantity
from softclose.metrics.intervals import Interval, Proportion
from softclose.metrics.open_kinds import open_kinds
from softclose_workflows.analyses.drive_off import drive_off_to_json
from softclose_workflows.analyses.hold import Hold, hold_lines
from softclose_workflows.analyses.opening import openings_to_json, print_openings
from softclose_workflows.analyses.own_limits import OwnLimit, limit_lines
from softclose_workflows.analyses.references import beaten_lines, missing_lines
from softclose_workflows.tell.console import wide_console
from softclose_workflows.tell.labels import in_percent, interval, number
from softclose_workflows.tell.plain import finite, waveform_rows
from softclose_workflows.tell.tables import (
    beside,
    difference_with_interval,
    interval_kinds,
    points,
    print_designs,
    with_interval,
)

if TYPE_CHECKING:
    from softclose.metrics.paired import Comparison
    from softclose.metrics.race import Race
    from softclose_workflows.analyses.certify import Certification, Certified


def print_certification(result: Certification, holds: Sequence[Hold] = (), limits: Sequence[OwnLimit] = ()) -> None:
    """Candidates by certified g, the reference designs, the best one against each of them, and how they hold.

    limits: those of the campaign itself.
    """
    from softclose_workflows.run import records

    print_designs(
        f"Certified on {result.n_switches:,} new switches (seed {result.seed})",
        [
            (_label(result, d), waveform_rows(d.waveform.rows()), records.assessment_record(d.assessment, d.contacts))
            for d in (*result.candidates, *result.references)
        ],
        interval_kinds(result.best.assessment.confidence, result.n_switches),
    )
    console = wide_console()
    best = result.best
    p = best.assessment.p_nc_intervals
    console.print(f"best: {best.name}")
    console.print(f"  left open: {_proportion(p)}{beside(best.assessment.n_failed, best.assessment.n)}")
    console.print(f"  {open_kinds(best.response, best.assessment.closed_by_us).sentence}")
    for line in limit_lines(limits):
        console.print(f"  {line}")
    if best.assessment.limit is not None:
        console.print(f"  {best.assessment.limit.sentence}")
    for exceedance in best.assessment.p_exceed:
        touch = "of the switches that touch"
        console.print(f"  P(V > {exceedance.limit_cm_s:g} cm/s) {touch}: {_proportion(exceedance.probability)}")
        excess = with_interval(exceedance.excess_cm_s, *exceedance.excess_interval)
        console.print(f"  expected excess over {exceedance.limit_cm_s:g} cm/s: {excess} cm/s")
    a = best.assessment
    fastest = f"{100.0 * (1.0 - a.level):g} %"
    console.print(f"  mean V of the fastest {fastest} (CVaR): {with_interval(a.cvar_cm_s, *a.cvar_interval)} cm/s")
    for name, value in best.values.items():
        console.print(f"  {quantity_line(name, value)}")
    if best.training is not None:
        console.print(
            f"  certified g is {abs(best.optimism_cm_s):.2f} cm/s {'above' if best.optimism_cm_s > 0 else 'below'} the "
            f"training score {best.training.g_cm_s:.2f} (on {best.training.n_switches:,} switches)"
        )
    for reference in (*result.references, *(d for d in result.candidates[1:] if d.candidate == result.incumbent)):
        console.print(f"  against {reference.name}: {comparison_line(result.comparison(reference))}")
    beaten = beaten_lines(a, {d.name: d.assessment for d in result.references})
    for line in [
        *filter(None, [a.open_warning]),
        *hold_lines(holds, a.level),
        *beaten,
        *missing_lines(result.missing),
    ]:
        console.print(line)
    if result.openings is not None:
        o = result.openings
        print_openings(f"{best.name}, let go at {o.at_us:g} µs, on the same switches", o, best.assessment.level)


def quantity_line(name: str, value: Value) -> str:
    """`kinetic energy of the hardest impact: 0.123 (0.120–0.126) nJ`."""
    q = quantity(name)
    found = with_interval(value.estimate, *value.interval, least_digits(q.unit))
    return f"{q.long_name}: {found} {q.unit.removeprefix('1')}".rstrip()


def print_race(race: Race) -> None:
    """Each round of the race that chose what was certified, and what it says."""
    console = wide_console()
    for lap in race.laps:
        out = f"; out: {', '.join(str(i) for i in lap.out)}" if lap.out else ""
        console.print(
            f"race, {lap.n_switches:,} switches: {len(lap.racing)} candidates, best {lap.best}, "
            f"none better by more than {lap.margin_cm_s:.3f} cm/s{out}"
        )
    last, n = race.laps[-1], len(race.laps[0].racing)
    done = race.trajectories / (last.n_switches * n)
    spent = f"{race.trajectories:,} trajectories ({in_percent(done)} of all candidates on as many switches)"
    said = "decided" if race.decided else f"not decided to {race.tolerance_cm_s:g} cm/s: give more --switches"
    console.print(
        f"{said}: candidate {last.best} is the best of {n}, or within {last.margin_cm_s:.3f} cm/s of it "
        f"({in_percent(race.confidence)}); {spent}"
    )


def _label(result: Certification, design: Certified) -> str:
    if design.training is None:
        return design.name
    mark = ", best training score" if design.candidate == result.incumbent else ""
    return f"{design.name}{mark}\ntraining g {design.training.g_cm_s:.2f}"


def comparison_line(c: Comparison) -> str:
    """`v_u −21.40 (−21.90 to −20.80) cm/s, softer on 97.1 % of the 9,812 switches that touch under both, …`.

    The mean V is of pairs: it is not the difference of two means, each of those that touch under one drive.
    """
    speed = (
        "no difference of v_u, since too few switches touch under one of them"
        if math.isnan(c.v_u_cm_s)
        else f"v_u {difference_with_interval(c.v_u_cm_s, *c.v_u_interval)} cm/s"
    )
    softer = (
        f"softer on {in_percent(c.softer.estimate, 1)} of the {c.softer.n:,} switches that touch under both, mean V of "
        f"these {difference_with_interval(c.mean_cm_s, *c.mean_interval)} cm/s"
        if c.softer.n
        else "no switch touches under both"
    )
    return f"{speed}, {softer}, left open {points(c.p_nc, *c.p_nc_interval)} points"


def _proportion(p: Proportion) -> str:
    value = 100.0 * p.estimate
    digits = max(digits_of(value, 100.0 * low, 100.0 * high) for low, high in (p.wilson, p.clopper_pearson))

    def of(ends: Interval) -> str:
        return interval(100.0 * ends[0], 100.0 * ends[1], digits)

    wald, wilson, clopper = of(p.wald), of(p.wilson), of(p.clopper_pearson)
    return f"{number(value, digits)} % (Eq. 11: {wald}; Wilson {wilson}; Clopper-Pearson {clopper})"


def certification_to_json(
    result: Certification, holds: Sequence[Hold] = (), limits: Sequence[OwnLimit] = ()
) -> dict[str, Any]:
    """One object; undefined numbers are null."""

    def design(d: Certified) -> dict[str, Any]:
        return {
            "name": d.name,
            "candidate": d.candidate,
            "waveform": waveform_rows(d.waveform.rows()),
            "training": None
            if d.training is None
            else {
                "g_cm_s": d.training.g_cm_s,
                "v_u_cm_s": d.training.v_u_cm_s,
                "p_nc": d.training.p_nc,
                "n_switches": d.training.n_switches,
            },
            "optimism_cm_s": d.optimism_cm_s,
            "open": open_kinds(d.response, d.assessment.closed_by_us).to_dict(),
            "quantities": _quantities(d.values),
            "contacts": _quantities(d.contacts),
            **d.assessment.to_dict(),
        }

    plain: dict[str, Any] = finite(
        {
            "n_switches": result.n_switches,
            "seed": result.seed,
            "committed": result.committed,
            "incumbent": result.incumbent,
            "warning": result.best.assessment.open_warning,
            "hold": [hold.to_dict() for hold in holds],
            "limits": [found.to_dict() for found in limits],
            "drive_off": drive_off_to_json(result.drive_off),
            "candidates": [design(d) for d in result.candidates],
            "references": [design(d) for d in result.references],
            "missing_references": dict(result.missing),
            "opening": None if result.openings is None else openings_to_json(result.openings),
            "best_against": {r.name: result.comparison(r).to_dict() for r in result.references},
        }
    )
    return plain


def _quantities(values: Mapping[str, Value]) -> dict[str, dict[str, Any]]:
    return {
        name: {"estimate": value.estimate, "interval": list(value.interval), "unit": quantity(name).unit}
        for name, value in values.items()
    }
