"""Owns the origins: every word by which an engine says where a candidate comes from, and what that means."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

INITIAL = "initial"
SOBOL = "sobol"
LOCAL, RESTART = "trust-region", "restart"
BASIN = "prior-basin"
CMAES = "cmaes"
DIRECT = "direct"
BOTORCH = "botorch"
NSGA2 = "nsga2"
PAREGO = "parego"
PAPER_WIDEN, PAPER_GRID, PAPER_SIMPLEX = "paper-widen", "paper-grid", "paper-simplex"
SCOUT, EXPLORE = "explore-scout", "explore"
RERANK, POLISH, EXTRA = "finish-rerank", "finish-polish", "finish-extra"
EXTENDED = "extend"
RETRY = "retry"
FALLBACK = "fallback"
BY_HAND = "by-hand"

Group = Literal["start", "around the best", "everywhere", "descents", "finish", "fallback", "other"]
"""What charts tell apart; `other` is for engines that were plugged in."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """One origin, for tables and figures."""

    name: str
    """As stored; an origin of a plugged-in engine may be any other word."""
    stage: str
    """search, explore, finish or extend; "" where it may be any."""
    group: Group
    """The group that charts draw it in."""
    label: str
    """What a candidate of this origin is."""
    designed: bool = False
    """True where it was chosen without looking at earlier results."""


ORIGINS: dict[str, Origin] = {
    origin.name: origin
    for origin in (
        Origin(name=INITIAL, stage="search", group="start", label="the user's own waveform", designed=True),
        Origin(name=SOBOL, stage="search", group="start", label="space-filling design", designed=True),
        Origin(name=BASIN, stage="search", group="start", label="basin of the prior", designed=True),
        Origin(name=LOCAL, stage="search", group="around the best", label="Gaussian process, trust region"),
        Origin(name=RESTART, stage="search", group="start", label="design of a fresh start", designed=True),
        Origin(name=CMAES, stage="search", group="descents", label="CMA-ES"),
        Origin(name=DIRECT, stage="search", group="everywhere", label="DIRECT"),
        Origin(name=BOTORCH, stage="search", group="everywhere", label="BoTorch"),
        Origin(name=NSGA2, stage="search", group="descents", label="NSGA-II, v_u against p_nc"),
        Origin(name=PAREGO, stage="search", group="around the best", label="Gaussian process, one weighting"),
        Origin(name=PAPER_WIDEN, stage="search", group="start", label="published procedure: width of pulse 1"),
        Origin(name=PAPER_GRID, stage="search", group="start", label="published procedure: grid", designed=True),
        Origin(name=PAPER_SIMPLEX, stage="search", group="around the best", label="published procedure: simplex"),
        Origin(name=SCOUT, stage="explore", group="start", label="scout of a descent", designed=True),
        Origin(name=EXPLORE, stage="explore", group="descents", label="step of a descent"),
        Origin(name=RERANK, stage="finish", group="finish", label="basin again, larger ensemble"),
        Origin(name=POLISH, stage="finish", group="finish", label="polish, larger ensemble"),
        Origin(name=EXTRA, stage="finish", group="finish", label="beside a basin, larger ensemble"),
        Origin(name=EXTENDED, stage="extend", group="descents", label="step of a descent, after the campaign's end"),
        Origin(name=RETRY, stage="extend", group="other", label="failed candidate, computed again", designed=True),
        Origin(name=BY_HAND, stage="", group="other", label="waveform chosen by hand", designed=True),
        Origin(name=FALLBACK, stage="", group="fallback", label="in place of a proposal that failed", designed=True),
    )
}
"""Every origin that the shipped engines write, in the order of a campaign."""


def group_of(name: str) -> Group:
    """The group of an origin as stored. `fallback: sobol` says which engine stood in."""
    known = ORIGINS.get(name.partition(":")[0])
    return "other" if known is None else known.group


def label_of(name: str) -> str:
    """What a candidate of this origin is; a word of a plugged-in engine says itself."""
    known = ORIGINS.get(name.partition(":")[0])
    return name if known is None else known.label
