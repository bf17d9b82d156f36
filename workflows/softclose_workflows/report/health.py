"""Owns the health checks of a campaign, in words: do intervals hold, is the budget used, do optima agree, does the
surrogate foretell what it has not seen, and did the process know how sure it was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softclose.metrics.control import PAYS, pays
from softclose_workflows.analyses.distinct import APART_V
from softclose_workflows.report.data import ReportData
from softclose_workflows.report.shapes import best_so_far
from softclose_workflows.run.controlled import GAIN, first_wave
from softclose_workflows.tell.labels import count, number, percent

LAST_PART = 4
"""The last of so many equal parts of a campaign still improved it, or did not."""
SMALL_GAIN_CM_S = 0.1
"""What the last part may still gain in a campaign that has converged [cm/s]."""
AS_GOOD = 0.02
"""Part of the best g by which another waveform may be worse and still be as good for any practical purpose."""
SURE = 0.85
"""Least share of candidates within two standard deviations of what the surrogate foretells (a normal error: 0.95)."""


FEWEST = 20
"""Predictions below which their calibration says nothing."""
LEAST_WITHIN_1, MOST_WITHIN_1 = 0.55, 0.8
"""Shares within one stated deviation that need no attention (a normal error: 0.68)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One check."""

    name: str
    """What was looked at."""
    good: bool
    """Whether it needs no attention."""
    said: str
    """What was found, in one or two sentences."""


def health(data: ReportData) -> list[Check]:
    """The checks that this campaign allows; [] where nothing has a result yet."""
    if data.best is None:
        return []
    checks = (
        _intervals(data),
        _budget(data),
        _changed(data),
        _progress(data),
        _optima(data),
        _surrogate(data),
        _calibration(data),
        _control(data),
    )
    return [check for check in checks if check is not None]


def _intervals(data: ReportData) -> Check:
    a = data.judged_designs[0].assessment
    if data.certification is not None:
        said = (
            f"The intervals hold for sampling: the {count(a.n)} switches are independent, and the search never saw "
            "them. They cover only that their number is finite: no error of the device model, and no lot that is "
            "distributed otherwise than assumed."
        )
        return Check(name="Intervals", good=True, said=said)
    if not a.intervals_valid:
        said = "No interval holds for one quasi-random sample. Certify the result to have intervals."
    else:
        said = (
            "The intervals do not account for the choice of the best of many candidates: training scores are "
            "optimistic. Certify the result."
        )
    return Check(name="Intervals", good=False, said=said)


def _budget(data: ReportData) -> Check:
    n, failed = data.n_committed, int(data.candidates.failed.sum())
    stood_in = sum(origin.startswith("fallback") for origin in data.candidates.origin)
    said = f"{count(n)} of {count(data.n_total)} candidates were evaluated"
    said += f", {count(failed)} of them failed" if failed else ", none failed"
    said += f"; {count(stood_in)} replace a proposal that failed." if stood_in else "."
    return Check(name="Budget", good=data.finished and not failed and not stood_in, said=said)


def _changed(data: ReportData) -> Check | None:
    """Readings that a person corrected or withdrew, waveforms that a person chose: nothing of it is hidden."""
    if not data.changes:
        return None
    said = "; ".join(data.changes)
    return Check(name="By hand", good=True, said=f"{said[:1].upper()}{said[1:]}. What was told first is kept.")


def _progress(data: ReportData) -> Check | None:
    """What the last part of the candidates on the largest ensemble gained."""
    g, sizes = data.candidates.columns["g_cm_s"], data.candidates.n_switches
    usable = np.flatnonzero(np.isfinite(g) & ~data.candidates.failed & (sizes == sizes.max()))
    if usable.size < 2 * LAST_PART:
        return None
    best, _ = best_so_far(usable, g[usable], data.candidates.columns["rank_cm_s"][usable], sizes[usable])
    gained = float(best[-1 - usable.size // LAST_PART] - best[-1])
    good = gained <= SMALL_GAIN_CM_S
    said = (
        f"The last quarter of the candidates on the largest ensemble lowered g by {number(gained, 2)} cm/s (no more "
        f"than {number(SMALL_GAIN_CM_S, 2)} is asked for)"
    )
    said += "." if good else ": the search had not converged. Give it more candidates (softclose resume --budget)."
    return Check(name="Convergence", good=good, said=said)


def _optima(data: ReportData) -> Check | None:
    """The best waveform beside the next best one that is a different one."""
    if len(data.places) < 2 or data.places[0] not in data.places:
        return None
    g, first, second = data.candidates.columns["g_cm_s"], data.places[0], data.places[1]
    apart = float(g[second] - g[first])
    half = 0.5 * float(data.candidates.columns["g_upper_cm_s"][first] - data.candidates.columns["g_lower_cm_s"][first])
    than = f"{number(abs(apart), 2)} cm/s {'higher' if apart > 0.0 else 'lower'}"
    said = (
        f"The next best waveform that differs from it by more than {APART_V:g} V (root mean square) is candidate "
        f"{second}, whose g on the training switches is {than}"
    )
    if np.isfinite(half) and apart <= half:
        said += ": rather different waveforms are equally good, within the interval."
    elif apart <= AS_GOOD * abs(float(g[first])):
        said += f", which is less than {percent(AS_GOOD, 0)}: a rather different waveform is practically as good."
    else:
        said += ": no rather different waveform that was tried comes near."
    return Check(name="Optima", good=True, said=said)


def _surrogate(data: ReportData) -> Check | None:
    if data.dependence is None:
        return None
    left = data.dependence.left_out
    said = (
        f"When each candidate of the better half is left out in turn, a surrogate fitted to the others predicts its g "
        f"to {number(left.median_error_cm_s, 2)} cm/s (median), and {percent(left.share_inside, 0)} lie within two of "
        f"its standard deviations (at least {percent(SURE, 0)} is asked for; of normal errors, 95\u202f%)."
    )
    return Check(name="Surrogate", good=left.share_inside >= SURE, said=said)


def _calibration(data: ReportData) -> Check | None:
    """What came of the candidates that the process proposed, in the deviations that it stated before."""
    said, g = data.candidates.surrogate, data.candidates.columns["g_cm_s"]
    if "predicted_sd_cm_s" not in said:
        return None
    error = np.abs(g - said["predicted_g_cm_s"]) / said["predicted_sd_cm_s"]
    error = error[np.isfinite(error) & ~data.candidates.failed]
    if error.size < FEWEST:
        return None
    one, two = float((error <= 1.0).mean()), float((error <= 2.0).mean())
    text = (
        f"Of {count(error.size)} candidates that the Gaussian process proposed, {percent(one, 0)} came within one and "
        f"{percent(two, 0)} within two of the standard deviations that it had stated (asked for are "
        f"{100.0 * LEAST_WITHIN_1:g} to {percent(MOST_WITHIN_1, 0)} and at least {percent(SURE, 0)}; of normal errors, "
        "68 and 95\u202f%)."
    )
    return Check(name="Deviations", good=LEAST_WITHIN_1 <= one <= MOST_WITHIN_1 and two >= SURE, said=text)


FEW_CONTROLLED, HELD_OF_80 = 256, "of 80 it was measured to hold 90 % of a stated 95 at the least"
"""Switches from which on it holds, and what was found of fewer (docs/measurements/coverage.md)."""


def _control(data: ReportData) -> Check | None:
    """Whether the prior is a control variate of the figures, and by how much that narrows them."""
    if GAIN not in data.candidates.columns:
        return None
    gains = data.candidates.columns[GAIN][: first_wave(data.config)]
    known = gains[np.isfinite(gains)]
    if not known.size:
        said = "The prior could not serve as control variate: it had no answer to the candidates of the first wave."
        return Check(name="Control variate", good=False, said=f"{said} Figures are those of the campaign's switches.")
    said = (
        f"With the prior on the same and on {count(data.config.prior.control)} further switches as control variate, "
        f"the standard error of g was {percent(float(np.median(known)), 0)} of that without it (median of the first "
        f"wave; {percent(PAYS, 0)} or less is asked for)"
    )
    used = "g, v_u, the mean speed and the share left open of every candidate rest on both models."
    if pays(gains.tolist()):
        said += f": {used}"
        if data.config.population.n_switches < FEW_CONTROLLED:
            said += (
                f" Of so few switches the interval of the mean speed may hold less often than it says: {HELD_OF_80}."
            )
    else:
        said += ": that does not pay, and no figure uses it."
    return Check(name="Control variate", good=True, said=said)
