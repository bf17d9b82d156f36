"""Owns the words of the page: what each means in this campaign, in one sentence, beside its first use and at the end.

`docs/glossary.md` says the same for all campaigns; a test compares the terms.
"""

from __future__ import annotations

from softclose.settings import CampaignConfig
from softclose.settings.scaled import PUBLISHED, PUBLISHED_V_U_CM_S
from softclose_workflows.analyses.references import REFERENCES
from softclose_workflows.report.data import ReportData
from softclose_workflows.tell.labels import count, percent


def glossary(data: ReportData) -> dict[str, tuple[str, str]]:
    """(term, what it means) of every word that the page needs, by the key of its anchor, in alphabetical order."""
    config = data.config
    o, level = config.objective, 100.0 * config.objective.level
    until = f" from {o.closed_by_us:g} µs on and" if o.closed_by_us else ""
    words = {
        "candidate": ("candidate", "one waveform that the search proposed and simulated; they are numbered from 0"),
        "certified": (
            "certified",
            "judged by softclose certify on new simulated switches that no part of the search has seen; only such "
            "figures should be quoted",
        ),
        "deterministic": ("deterministic design", f"a reference waveform: {REFERENCES['deterministic']}"),
        "g": ("g", f"the objective that the search lowers, in cm/s: {objective_words(config)}"),
        "hold": (
            "hold margin",
            "the voltage at the end minus the voltage below which that closed switch lets go; where it is negative the "
            "switch does not stay closed",
        ),
        "interval": (
            "interval",
            f"the range in which the figure of the whole lot lies with {percent(o.confidence, 0)} confidence, because "
            "only so many switches were simulated; it covers no error of the model or of the assumed lot",
        ),
        "lot": (
            "lot, population",
            "the switches that the waveform is designed for, described by distributions of their properties; "
            f"“{config.population.name}” is the name of this one",
        ),
        "open": (
            "left open, closed",
            f"a switch is closed if it is held in contact{until} at the end of the {config.model.horizon_us:g} µs "
            "simulated; any other is left open",
        ),
        "optimism": (
            "optimism",
            "certified g minus the training score: the part of that score that is luck with the training switches",
        ),
        "training": (
            "training switches, training score",
            "the simulated switches that the search uses, and g on them; a training score is optimistic",
        ),
        "unshaped": ("unshaped step", f"a reference waveform: {REFERENCES['unshaped']}"),
        "v": ("V, mean V", "V is the largest impact speed of one switch; its mean is over the switches that touch"),
        "v_u": ("v_u, upper velocity", f"{level:g} % of the switches that touch hit no faster"),
    }
    if data.dependence is not None or any(name.startswith("predicted_") for name in data.candidates.surrogate):
        words["surrogate"] = (
            "Gaussian process, surrogate",
            "the statistical model that predicts g, with a standard deviation, of waveforms that are not simulated "
            "yet, and so decides which one to try next",
        )
    if "prior_g_cm_s" in data.candidates.surrogate:
        words["prior"] = (
            "prior",
            f"what was learned from a cheap model ({config.prior.model} on {count(config.prior.n_switches)} switches) "
            "before the first candidate was simulated",
        )
    if config.population.sampling == "replicated":
        words["replicated"] = (
            "replicated sampling",
            "the training switches are 16 independent, evenly spread samples; the differences between these give the "
            "intervals",
        )
    if o.limits_cm_s:
        words["limit"] = (
            f"{o.limits_cm_s[0]:g} cm/s",
            "the speed above which switches are counted (objective.limits_cm_s). Unless it is set, it is to the lot "
            f"what {PUBLISHED['limits_cm_s']:g} cm/s, the upper velocity of the published two-pulse design, is to the "
            f"published lot, which a plain step closes at {PUBLISHED_V_U_CM_S:g} cm/s",
        )
    return dict(sorted(words.items(), key=lambda item: item[1][0].lower()))


def objective_words(config: CampaignConfig) -> str:
    """`g = v_u + 25 cm/s × the share left open, …`."""
    o = config.objective
    speed = "v_u" if o.risk == "quantile" else f"mean V of the fastest {100.0 * (1.0 - o.level):g} %"
    if o.form == "penalty":
        said = (
            f"g = {speed} + {o.c1_cm_s:g} cm/s × the share left open, so that one percentage point more left open "
            f"counts as {o.c1_cm_s / 100.0:g} cm/s"
        )
    else:
        said = (
            f"g = {speed} + {o.chance_penalty_cm_s:g} cm/s × what the share left open exceeds {percent(o.p_max, 2)} by"
        )
    also = [*(f"{name} (weight {w:g})" for name, w in sorted(o.weights.items()))]
    also += [f"a penalty where {name} passes {limit:g}" for name, limit in sorted(o.quantity_limits.items())]
    return f"{said}; beside it {', '.join(also)}" if also else said
