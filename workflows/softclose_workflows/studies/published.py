"""Owns the published figures and the campaigns that reproduce them."""

from __future__ import annotations

from dataclasses import dataclass

LIMIT_CM_S = 19.7
"""Contact speed whose exceedance the study prints."""

N_PUBLISHED = 200
"""Switches behind every published figure."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Published:
    """What the study prints of one design."""

    v_u_cm_s: float
    """Upper velocity [cm/s]."""
    mean_cm_s: float
    """Mean contact speed [cm/s]."""
    p_exceed: tuple[float, float] | None = None
    """95 % bounds of P(V > 19.7 cm/s), where printed."""


UNSHAPED = Published(v_u_cm_s=40.7, mean_cm_s=34.1)
DETERMINISTIC = Published(v_u_cm_s=42.6, mean_cm_s=24.7, p_exceed=(0.50, 0.63))
CURRENT = Published(v_u_cm_s=19.7, mean_cm_s=15.3, p_exceed=(0.08, 0.17))
THREE = Published(v_u_cm_s=18.8, mean_cm_s=14.0)
MODIFIED = Published(v_u_cm_s=12.5, mean_cm_s=10.7)
IMPROVED = Published(v_u_cm_s=12.8, mean_cm_s=9.6)


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedCase:
    """One row of the comparison."""

    title: str
    """The design."""
    how: str
    """How its waveform was found."""
    preset: str
    """Campaign that it belongs to."""
    design: str = "best"
    """`best`, or a reference design of the campaign's certification."""
    published: Published | None = None
    """The study's figures; None where it has none."""
    figure: str = ""
    """Published figures that this case's own figure corresponds to."""


CASES = (
    PublishedCase(
        title="unshaped 100 V", how="ideal step", preset="current-two", design="unshaped", published=UNSHAPED
    ),
    PublishedCase(
        title="deterministic design",
        how="solved for the mean switch",
        preset="current-two",
        design="deterministic",
        published=DETERMINISTIC,
        figure="6, 7",
    ),
    PublishedCase(
        title="current design, 2 pulses", how="published procedure", preset="current-paper", published=CURRENT
    ),
    PublishedCase(
        title="current design, 2 pulses", how="softclose", preset="current-two", published=CURRENT, figure="8, 9"
    ),
    PublishedCase(
        title="current design, 3 pulses", how="DIRECT, 350 evaluations", preset="current-direct", published=THREE
    ),
    PublishedCase(title="current design, 3 pulses", how="softclose", preset="current-three", published=THREE),
    PublishedCase(
        title="modified design, 2 pulses", how="published procedure", preset="modified-paper", published=MODIFIED
    ),
    PublishedCase(
        title="modified design, 2 pulses", how="softclose", preset="modified", published=MODIFIED, figure="10, 11"
    ),
    PublishedCase(title="modified design, 3 pulses", how="softclose", preset="modified-three"),
    PublishedCase(
        title="improved process, 2 pulses",
        how="published procedure",
        preset="process-improved-paper",
        published=IMPROVED,
    ),
    PublishedCase(
        title="improved process, 2 pulses", how="softclose", preset="process-improved", published=IMPROVED, figure="12"
    ),
    PublishedCase(title="improved process, 3 pulses", how="softclose", preset="process-improved-three"),
    PublishedCase(title="unshaped 100 V, literal ±25 %", how="ideal step", preset="paper-text", design="unshaped"),
    PublishedCase(title="current design, literal ±25 %, 2 pulses", how="softclose", preset="paper-text"),
)


def presets() -> list[str]:
    """The presets of all cases, each once, in order."""
    return list(dict.fromkeys(case.preset for case in CASES))
