"""Owns what is said of hold: how far above its release voltage each switch is held, and how many are not.

A low hold voltage is a soft one. What a search wins by it is lost where a device ages, or a supply sags.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from softclose.arrays import FloatArray
from softclose.evaluate.chain import chain_of, drives_of
from softclose.evaluate.pieces import Mapper, here
from softclose.evaluate.quantities import Value, held_voltages, hold_margins, quantity
from softclose.plugins import MEASURED
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.waveform import Drive, Waveform
from softclose_workflows.analyses.certification import Certification
from softclose_workflows.analyses.certify import MANY, FreshSwitches, fresh_pieces
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
    for_everybody: bool = False
    """Whether the drive was tailored to no switch, as a reference design."""


def holds_of(config: CampaignConfig, certification: Certification, *, mapper: Mapper = here) -> tuple[Hold, ...]:
    """How the best candidate and the reference designs hold, on the certificate's switches.

    Parameters
    ----------
    config : CampaignConfig
        The campaign's.
    certification : Certification
        Its certificate.
    mapper : Mapper
        Who looks, where the switches are many.

    Returns
    -------
    tuple of Hold
        As `holds_on`, the best first.
    """
    if config.model.name == MEASURED:
        return ()
    n, designs = certification.n_switches, (certification.best, *certification.references)
    pieces = fresh_pieces(
        config,
        n,
        seed=certification.seed,
        drives=[d.waveform for d in designs],
        for_everybody=[i for i, d in enumerate(designs) if d.candidate is None],
    )
    margins, held = np.empty((len(designs), n)), np.empty((len(designs), n))
    for piece, found in zip(pieces, (mapper if n > MANY else here)(_held, pieces), strict=True):
        margins[:, piece.rows.start : piece.rows.stop], held[:, piece.rows.start : piece.rows.stop] = found
    holds = (_hold(config, d.name, margins[i], held[i], has_interval=True) for i, d in enumerate(designs))
    return tuple(hold for hold in holds if hold is not None)


def _held(piece: FreshSwitches) -> tuple[FloatArray, FloatArray]:
    """Margin and voltage of each switch of a piece under each of its drives, (n_drives, n) each."""
    config, lot = piece.sent.config, piece.lot
    each = [_margins(config, lot, d, for_everybody=i in piece.for_everybody) for i, d in enumerate(piece.drives)]
    margins, held = zip(*each, strict=True)
    return np.stack(margins), np.stack(held)


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
    found = (
        _hold(
            config,
            d.name,
            *_margins(config, lot, d.waveform, for_everybody=d.for_everybody),
            has_interval=has_interval,
        )
        for d in designs
    )
    return tuple(hold for hold in found if hold is not None)


def _margins(
    config: CampaignConfig, lot: Lot, waveform: Drive, *, for_everybody: bool
) -> tuple[FloatArray, FloatArray]:
    """(n,) hold voltage above the release voltage of each switch, NaN where that is not known, and the hold voltage
    itself [V]."""
    chain = chain_of(config)
    held_V = held_voltages(chain, lot, waveform, drives_of(chain, lot, waveform, for_everybody=for_everybody))
    return hold_margins(chain, lot, held_V), held_V


def _hold(
    config: CampaignConfig, name: str, margins: FloatArray, held_V: FloatArray, *, has_interval: bool
) -> Hold | None:
    """What is said of them; None where no release voltage is known."""
    if np.isnan(margins).all():
        return None
    o = config.objective
    return Hold(
        name=name,
        margin_V=quantity(MARGIN).of_column(margins, level=o.level, confidence=o.confidence, has_interval=has_interval),
        least_V=float(np.nanmin(margins)),
        held_V=float(held_V.mean()),
        n=int((~np.isnan(margins)).sum()),
        n_short=int((margins < 0.0).sum()),
    )


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
