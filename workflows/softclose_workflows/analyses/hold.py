"""Owns what a certificate says of hold: how far above its release voltage each switch of the new ones is held.

A low hold voltage is a soft one. What a search wins by it is lost where a device ages, or a supply sags.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, cast

import numpy as np

from softclose.device.simulate import Responses
from softclose.evaluate.chain import chain_of, drives_of
from softclose.evaluate.quantities import Closing, Value, held_voltages, quantity
from softclose.plugins import MEASURED
from softclose.settings import CampaignConfig
from softclose_workflows.analyses.certification import Certification
from softclose_workflows.analyses.certify import fresh_switches
from softclose_workflows.tell.labels import number
from softclose_workflows.tell.tables import with_interval

MARGIN = "hold_margin"
SMALL = 0.1
"""Part of the hold voltage below which the least margin of a lot is remarked upon."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold:
    """How one design holds the switches of a certificate."""

    name: str
    """Of the design."""
    margin_V: Value
    """Hold voltage above the release voltage: what 90 % (the level) of the switches have at least [V]."""
    least_V: float
    """The least of all of them [V]; below 0 it does not hold."""
    held_V: float
    """Mean voltage at the end of the simulation [V]."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self)


def holds_of(config: CampaignConfig, certification: Certification) -> tuple[Hold, ...]:
    """How the best candidate and the reference designs hold, on the certificate's switches.

    Parameters
    ----------
    config : CampaignConfig
        The campaign's.
    certification : Certification
        Its certificate.

    Returns
    -------
    tuple of Hold
        The best first. () where the devices themselves are measured, or the model is somebody else's, whose release
        voltages are not known.
    """
    if config.model.name == MEASURED:
        return ()
    lot = fresh_switches(config, certification.n_switches, seed=certification.seed)
    o, chain, margin = config.objective, chain_of(config), quantity(MARGIN)
    found = []
    for design in (certification.best, *certification.references):
        drives = drives_of(chain, lot, design.waveform, for_everybody=design.candidate is None)
        closing = Closing(
            chain=chain,
            lot=lot,
            waveform=design.waveform,
            response=cast(Responses, design.response),
            held_V=held_voltages(chain, lot, design.waveform, drives),
        )
        values = margin.values(closing)
        if np.isnan(values).all():
            continue
        found.append(
            Hold(
                name=design.name,
                margin_V=margin.of_column(values, level=o.level, confidence=o.confidence, has_interval=True),
                least_V=float(np.nanmin(values)),
                held_V=float(closing.held_V.mean()),
            )
        )
    return tuple(found)


def hold_line(holds: Sequence[Hold], level: float) -> str | None:
    """The best design's hold beside that of the references; None where nothing is known of it."""
    if not holds:
        return None
    best, *others = holds
    margin = with_interval(best.margin_V.estimate, *best.margin_V.interval)
    said = f"hold margin: {100.0 * level:g} % of the switches are held {margin} V or more above the voltage at which "
    said += f"they let go, the least is {number(best.least_V, 2)} V ({best.held_V:.2f} V held)"
    beside = [f"{h.name} {number(h.margin_V.estimate, 2)} V, the least {number(h.least_V, 2)} V" for h in others]
    return "; ".join([said, *beside])


def hold_warning(holds: Sequence[Hold]) -> str | None:
    """That the best design leaves little, or nothing, of its hold voltage to one switch; None where it does not."""
    if not holds or holds[0].least_V >= SMALL * holds[0].held_V:
        return None
    best = holds[0]
    what = f"holds one switch with only {best.least_V:.2f} V to spare of {best.held_V:.2f} V"
    if best.least_V < 0.0:
        what = f"holds with {best.held_V:.2f} V, and one switch needs {-best.least_V:.2f} V more to stay closed"
    return (
        f"WARNING: {best.name} {what}: "
        "part of its softness may be bought with hold, which creep, charge and a sagging supply take away"
    )


def hold_lines(holds: Sequence[Hold], level: float) -> list[str]:
    """What is said of hold at a terminal, the warning last; [] where nothing is known of it."""
    return [*filter(None, [hold_line(holds, level), hold_warning(holds)])]
