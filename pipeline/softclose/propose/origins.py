"""Owns the origins: every word by which an engine says where a candidate comes from, and what that means."""

from __future__ import annotations

from dataclasses import dataclass

INITIAL = "initial"
SOBOL = "sobol"
LOCAL, GLOBAL, RESTART = "trust-region", "global", "restart"
CMAES = "cmaes"
DIRECT = "direct"
BOTORCH = "botorch"
PAPER_WIDEN, PAPER_GRID, PAPER_SIMPLEX = "paper-widen", "paper-grid", "paper-simplex"
SCOUT, EXPLORE = "explore-scout", "explore"
RERANK, POLISH, EXTRA = "finish-rerank", "finish-polish", "finish-extra"
FALLBACK = "fallback"


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """One origin, for tables and figures."""

    name: str
    """As stored; an origin of a plugged-in engine may be any other word."""
    stage: str
    """search, explore or finish; "" where it may be any."""
    label: str
    """What a candidate of this origin is."""
    designed: bool = False
    """True where it was chosen without looking at earlier results."""


ORIGINS: dict[str, Origin] = {
    origin.name: origin
    for origin in (
        Origin(name=INITIAL, stage="search", label="the user's own waveform", designed=True),
        Origin(name=SOBOL, stage="search", label="space-filling design", designed=True),
        Origin(name=LOCAL, stage="search", label="Gaussian process, trust region"),
        Origin(name=GLOBAL, stage="search", label="Gaussian process, everywhere"),
        Origin(name=RESTART, stage="search", label="design of a fresh start", designed=True),
        Origin(name=CMAES, stage="search", label="CMA-ES"),
        Origin(name=DIRECT, stage="search", label="DIRECT"),
        Origin(name=BOTORCH, stage="search", label="BoTorch"),
        Origin(name=PAPER_WIDEN, stage="search", label="published procedure: width of pulse 1"),
        Origin(name=PAPER_GRID, stage="search", label="published procedure: grid", designed=True),
        Origin(name=PAPER_SIMPLEX, stage="search", label="published procedure: simplex"),
        Origin(name=SCOUT, stage="explore", label="scout of a descent", designed=True),
        Origin(name=EXPLORE, stage="explore", label="step of a descent"),
        Origin(name=RERANK, stage="finish", label="basin again, larger ensemble"),
        Origin(name=POLISH, stage="finish", label="polish, larger ensemble"),
        Origin(name=EXTRA, stage="finish", label="beside a basin, larger ensemble"),
        Origin(name=FALLBACK, stage="", label="in place of a proposal that failed", designed=True),
    )
}
"""Every origin that the shipped engines write, in the order of a campaign."""
