"""Owns the tables that commands print."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from softclose.device.status import not_integrated
from softclose.digits import LEAST, digits_of, least_digits
from softclose.metrics.intervals import Interval, unseen_share
from softclose.metrics.replicates import REPLICATES
from softclose_store import Best
from softclose_workflows.tell.console import wide_console
from softclose_workflows.tell.labels import estimated, estimated_difference, in_percent, interval
from softclose_workflows.tell.plain import waveform_rows
from softclose_workflows.tell.standing import Standing


def describe_waveform(rows: Sequence[Sequence[float | None]]) -> str:
    """One line a pulse: `150.00 V from 0.00 µs, rise 4.00 µs, top 5.31 µs`."""
    lines = []
    for start, rise, peak, volts in rows:
        top = "holds" if peak is None or math.isinf(peak) else f"top {peak:.2f} µs"
        edge = "ideal step" if rise == 0 else f"rise {rise:.2f} µs"
        lines.append(f"{volts:.2f} V from {start:.2f} µs, {edge}, {top}")
    return "\n".join(lines)


def with_interval(value: float, lower: float = math.nan, upper: float = math.nan, least: int = LEAST) -> str:
    """`19.70 (19.21–20.14)`; a dash where there is no value, ∞ where too few switches have one.

    Figure and interval have the same digits, at least `least` of them (`softclose.digits`).
    """
    return _bracketed(value, *estimated(value, lower, upper, least=least))


def share(value: float, lower: float = math.nan, upper: float = math.nan, least: int = LEAST) -> str:
    """A share of the switches: `7.15 % (6.99–7.31)`; a dash where there is none."""
    digits = digits_of(100.0 * value, 100.0 * lower, 100.0 * upper, least)
    return _bracketed(value, in_percent(value, digits), interval(100.0 * lower, 100.0 * upper, digits))


def points(difference: float, lower: float = math.nan, upper: float = math.nan) -> str:
    """A difference of two shares, in percentage points: `+7.15 (+6.99 to +7.31)`."""
    return difference_with_interval(100.0 * difference, 100.0 * lower, 100.0 * upper)


def difference_with_interval(value: float, lower: float = math.nan, upper: float = math.nan) -> str:
    """`−26.41 (−26.49 to −26.32)`; a dash where there is none."""
    return _bracketed(value, *estimated_difference(value, lower, upper))


def _bracketed(value: float, text: str, bounds: str) -> str:
    return "–" if math.isnan(value) else f"{text} ({bounds})" if bounds else text


def interval_kinds(confidence: float, n: int, sampling: str = "monte-carlo") -> str:
    """What the intervals of a table are, and what none of them knows; n: switches, sampling: how they were drawn.

    Which of them keep their promise, and for which n: docs/measurements/coverage.md.
    """
    if sampling == "sobol":
        return "one quasi-random sample: no interval holds for it."
    if sampling == "replicated":
        return (
            f"{in_percent(confidence)} intervals: from the spread of {REPLICATES} independent scramblings; none covers "
            "an error of the device model, or a lot that is distributed otherwise."
        )
    return (
        f"{in_percent(confidence)} intervals: order statistics (v_u), Student and Hall (mean V, CVaR), Wilson (left "
        f"open: right on average, down to 84 % near 0 and 1). None knows of a group that no switch is from: up to "
        f"{100.0 * unseen_share(n, confidence):.2g} % of a lot can be missing from {n:,}. None covers an error "
        "of the device model, or a lot that is distributed otherwise."
    )


def metrics_row(record: Mapping[str, Any]) -> list[str]:
    """v_u, mean V, p_nc and g of one record, each with its interval."""
    return [
        with_interval(record["v_u_cm_s"], record["v_u_lower_cm_s"], record["v_u_upper_cm_s"]),
        with_interval(record["mean_cm_s"], record["mean_lower_cm_s"], record["mean_upper_cm_s"]),
        share_open(
            record["p_nc"],
            (record["p_nc_wilson_lower"], record["p_nc_wilson_upper"]),
            int(record["n_failed_switches"]),
        ),
        with_interval(record["g_cm_s"], record["g_lower_cm_s"], record["g_upper_cm_s"]),
    ]


def share_open(p_nc: float, bounds: Interval, n_failed: int) -> str:
    """p_nc with its interval, and below it how many switches could not be integrated, which it counts as open."""
    failed = f"\n{n_failed:,} not integrated" if n_failed else ""
    return share(p_nc, *bounds) + failed


def print_designs(
    title: str, designs: Sequence[tuple[str, Sequence[Sequence[float | None]], Mapping[str, Any]]], caption: str
) -> None:
    """One row a design: name, waveform, metrics with intervals, and how it closes."""
    from rich.table import Table

    table = Table(title=title, caption=caption, title_justify="left", caption_justify="left", show_lines=True)
    for column in ("design", "waveform"):
        table.add_column(column)
    for column in ("v_u [cm/s]", "mean V [cm/s]", "left open", "g [cm/s]", "closing [µs]"):
        table.add_column(column, justify="right", no_wrap=True)
    for name, rows, record in designs:
        table.add_row(name, describe_waveform(rows), *metrics_row(record), "\n".join(closing_lines(record)))
    wide_console().print(table)


def closing_lines(record: Mapping[str, Any]) -> list[str]:
    """`touch 26.4 (26.2–26.7)` and `closed 29.0 (28.8–29.2)` [µs], and the number of impacts.

    All are what the level-quantile of the switches has at most; contacts are told where the record has them.
    """

    held = with_interval(
        record["closing_us"], record["closing_lower_us"], record["closing_upper_us"], least_digits("µs")
    )
    lines = [f"closed {held}"]
    for at, name, word, digits in ((0, "contact_time", "touch", least_digits("µs")), (2, "impacts", "impacts", 0)):
        if name in record:
            found = with_interval(record[name], record[f"{name}_lower"], record[f"{name}_upper"], digits)
            lines.insert(at, f"{word} {found}")
    return lines


def beside(n_failed: int, n: int) -> str:
    """`; 3 of 50 switches could not be integrated`, to stand behind p_nc; empty where all could."""
    return f"; {not_integrated(n_failed, n)}" if n_failed else ""


def n_failed_of(best: Best) -> int:
    """Switches of the best candidate that could not be integrated; 0 in stores that do not know."""
    return max(int(best.record.get("n_failed_switches", 0)), 0)


def _known(value: float) -> str:
    return with_interval(value, math.nan, math.nan)


def trouble_lines(standing: Standing) -> list[str]:
    """What went wrong with candidates of a campaign, a sentence each; [] where nothing did."""
    lines = []
    if standing.failed:
        lines.append(f"{standing.failed} of {standing.committed} candidates failed")
    if standing.fallbacks:
        what = "quasi-random points in place of proposals that failed"
        lines.append(f"{standing.fallbacks} of {standing.committed} candidates are {what}")
    if lines:
        lines.append(f"first reason: {standing.reason}")
    return lines


def print_standing(standing: Standing) -> None:
    """What `status` prints for people."""
    from softclose_workflows.terminal import plain_console

    console = plain_console()
    console.soft_wrap = not console.is_terminal  # a log gets a sentence a line
    done = standing.committed / max(standing.budget, 1)
    state = "finished" if standing.finished else in_percent(done)
    console.print(f"{standing.name}: {standing.committed:,} of {standing.budget:,} candidates committed ({state})")
    for line in (*trouble_lines(standing), *standing.changes):
        console.print(line)
    best = standing.best
    if best is None:
        console.print("no usable candidate yet")
        if standing.failed and standing.failed == standing.committed:
            console.print("all have failed; where their reason is mended: softclose resume STORE --retry-failed")
        return
    console.print(
        f"best: candidate {best.candidate}, g {best.g_cm_s:.2f} cm/s, v_u {_known(best.v_u_cm_s)} cm/s, "
        f"mean V {_known(best.mean_cm_s)} cm/s, {share(best.p_nc)} left open on {best.n_switches:,} switches"
        + beside(n_failed_of(best), best.n_switches)
    )
    if standing.warning:
        console.print(standing.warning)
    if standing.limit is not None:
        console.print(standing.limit.sentence)
    console.print(describe_waveform(waveform_rows(best.waveform)))
