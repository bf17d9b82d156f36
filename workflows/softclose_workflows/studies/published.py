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
class Case:
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
    Case(title="unshaped 100 V", how="ideal step", preset="current-two", design="unshaped", published=UNSHAPED),
    Case(
        title="deterministic design",
        how="solved for the mean switch",
        preset="current-two",
        design="deterministic",
        published=DETERMINISTIC,
        figure="6, 7",
    ),
    Case(title="current design, 2 pulses", how="published procedure", preset="current-paper", published=CURRENT),
    Case(title="current design, 2 pulses", how="softclose", preset="current-two", published=CURRENT, figure="8, 9"),
    Case(title="current design, 3 pulses", how="DIRECT, 350 evaluations", preset="current-direct", published=THREE),
    Case(title="current design, 3 pulses", how="softclose", preset="current-three", published=THREE),
    Case(title="modified design, 2 pulses", how="published procedure", preset="modified-paper", published=MODIFIED),
    Case(title="modified design, 2 pulses", how="softclose", preset="modified", published=MODIFIED, figure="10, 11"),
    Case(title="modified design, 3 pulses", how="softclose", preset="modified-three"),
    Case(
        title="improved process, 2 pulses",
        how="published procedure",
        preset="process-improved-paper",
        published=IMPROVED,
    ),
    Case(
        title="improved process, 2 pulses", how="softclose", preset="process-improved", published=IMPROVED, figure="12"
    ),
    Case(title="improved process, 3 pulses", how="softclose", preset="process-improved-three"),
    Case(title="unshaped 100 V, literal ±25 %", how="ideal step", preset="paper-text", design="unshaped"),
    Case(title="current design, literal ±25 %, 2 pulses", how="softclose", preset="paper-text"),
)


def presets() -> list[str]:
    """The presets of all cases, each once, in order."""
    return list(dict.fromkeys(case.preset for case in CASES))
