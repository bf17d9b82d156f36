"""Owns what is said of hold: how far above its release voltage each switch is held, and how many are not.

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
from softclose.metrics.objective import Response
from softclose.plugins import MEASURED
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_workflows.analyses.certification import Certification
from softclose_workflows.analyses.certify import fresh_switches
from softclose_workflows.tell.labels import number
from softclose_workflows.tell.tables import with_interval

MARGIN = "hold_margin"
SMALL = 0.1
"""Part of the hold voltage below which the least margin of a lot is remarked upon."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold:
    """How one design holds the switches that it is judged on."""

    name: str
    """Of the design."""
    margin_V: Value
    """Hold voltage above the release voltage: what 90 % (the level) of the switches have at least [V]."""
    least_V: float
    """The least of all of them [V]; below 0 it does not hold."""
    held_V: float
    """Mean voltage at the end of the simulation [V]."""
    n: int
    """Switches whose release voltage is known."""
    n_short: int
    """Those that need more than they are held with."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Held:
    """A design whose hold is asked for."""

    name: str
    """What it is called."""
    waveform: Waveform
    """What was applied."""
    response: Response
    """What the switches did."""
    for_everybody: bool = False
    """Whether the drive was tailored to no switch, as a reference design."""


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
        As `holds_on`, the best first.
    """
    lot = fresh_switches(config, certification.n_switches, seed=certification.seed)
    designs = (certification.best, *certification.references)
    return holds_on(
        config,
        lot,
        [
            Held(name=d.name, waveform=d.waveform, response=d.response, for_everybody=d.candidate is None)
            for d in designs
        ],
    )


def holds_on(
    config: CampaignConfig, lot: Lot, designs: Sequence[Held], *, has_interval: bool = True
) -> tuple[Hold, ...]:
    """How designs hold a lot.

    Parameters
    ----------
    config : CampaignConfig
        Whose objective and conditions apply.
    lot : Lot
        The switches.
    designs : sequence of Held
        What was applied to them.
    has_interval : bool
        Whether they are independent random draws, so that intervals hold.

    Returns
    -------
    tuple of Hold
        In that order. () where the devices themselves are measured, or the model is somebody else's, whose release
        voltages are not known.
    """
    if config.model.name == MEASURED:
        return ()
    o, chain, margin = config.objective, chain_of(config), quantity(MARGIN)
    found = []
    for design in designs:
        drives = drives_of(chain, lot, design.waveform, for_everybody=design.for_everybody)
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
                margin_V=margin.of_column(values, level=o.level, confidence=o.confidence, has_interval=has_interval),
                least_V=float(np.nanmin(values)),
                held_V=float(closing.held_V.mean()),
                n=int((~np.isnan(values)).sum()),
                n_short=int((values < 0.0).sum()),
            )
        )
    return tuple(found)


def hold_line(holds: Sequence[Hold], level: float) -> str | None:
    """The best design's hold beside that of the references; None where nothing is known of it."""
    if not holds:
        return None
    best, *others = holds
    said = f"hold margin: {_most(best, level)}; the worst {_worst(best)} ({best.held_V:.2f} V are held)"
    beside = [f"{h.name}: {_margin(h, level)}, the worst {_worst(h)}" for h in others]
    return "; ".join([said, *beside])


def _most(hold: Hold, level: float) -> str:
    """`90 % of the switches are held 7.34 (7.26–7.42) V or more above the voltage at which they let go`."""
    value, (low, high) = hold.margin_V.estimate, hold.margin_V.interval
    if value < 0.0:  # then it is those at the other end who are known to lack so much
        lacking = with_interval(-value, -high, -low)
        return f"{_few(level)} of the switches are held {lacking} V or more below the voltage at which they let go"
    return (
        f"{100.0 * level:g} % of the switches are held {with_interval(value, low, high)} V or more above the voltage "
        "at which they let go"
    )


def _margin(hold: Hold, level: float) -> str:
    value = hold.margin_V.estimate
    if value < 0.0:
        return f"{_few(level)} lack {number(-value, 2)} V or more"
    return f"{100.0 * level:g} % have {number(value, 2)} V or more to spare"


def _few(level: float) -> str:
    return f"{100.0 * (1.0 - level):g} %"


def _worst(hold: Hold) -> str:
    if hold.least_V < 0.0:
        return f"needs {number(-hold.least_V, 2)} V more"
    return f"has {number(hold.least_V, 2)} V to spare"


def hold_warning(holds: Sequence[Hold]) -> str | None:
    """That the best design holds some switches with little, or not at all; None where it holds all of them well."""
    if not holds or holds[0].least_V >= SMALL * holds[0].held_V:
        return None
    best = holds[0]
    what = f"leaves the worst of {best.n:,} switches only {best.least_V:.2f} V to spare of the {best.held_V:.2f} V held"
    if best.n_short:
        needs = "needs" if best.n_short == 1 else "need"
        what = (
            f"holds with {best.held_V:.2f} V, and {best.n_short:,} of {best.n:,} switches {needs} more to stay closed, "
            f"the worst {-best.least_V:.2f} V more"
        )
    return (
        f"WARNING: {best.name} {what}: "
        "part of its softness may be bought with hold, which creep, charge and a sagging supply take away"
    )


def hold_lines(holds: Sequence[Hold], level: float) -> list[str]:
    """What is said of hold at a terminal, the warning last; [] where nothing is known of it."""
    return [*filter(None, [hold_line(holds, level), hold_warning(holds)])]
