"""Owns the sign-off: a certified waveform held against an engineer's limits, and what the verdict rests on."""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from pydantic import BaseModel, ConfigDict

from softclose import __version__
from softclose.allowed.tables import Number, checked
from softclose.device.simulate import Responses
from softclose.evaluate.quantities import QUANTITIES, Closing, Quantity, Value, quantity
from softclose.metrics.open_kinds import open_kinds
from softclose.naming import did_you_mean
from softclose.plugins import QuantityError
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store import open_campaign
from softclose_workflows.analyses.certification import Certification, Certified
from softclose_workflows.analyses.certify import fresh_switches, read_certification
from softclose_workflows.analyses.drive_off import drive_off_to_json
from softclose_workflows.analyses.hold import Hold, hold_warning, holds_of
from softclose_workflows.analyses.references import UNSHAPED
from softclose_workflows.analyses.verdict import LineVerdict, verdict_of
from softclose_workflows.tell.assumptions import assumptions
from softclose_workflows.tell.plain import finite, waveform_rows

SHOWN = ("v_u", "p_nc", "mean", "contact_time", "closing", "impacts", "hold_margin", "contact_force", "peak", "slope")
"""What a sheet shows, with a limit or without."""
ASK_IMPACTS = ("impact_energy", "impact_energy_sum", "impulse", "impulse_sum")
"""What a certificate does not tell: it keeps no single impacts."""
UNTOLD = ("contact_time", "impacts")
"""What a device model may not tell: then left out of the sheet unless it has a limit."""


class SignError(ValueError):
    """A sign-off that cannot be made as asked."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """One quantity, held against its limit."""

    quantity: Quantity
    """What it is."""
    value: Value
    """On the new switches."""
    limit: float | None
    """Largest admissible value, or the least one of a quantity that is better high; None: not judged."""
    verdict: LineVerdict
    """pass or fail where the whole interval lies on that side of the limit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """A sign-off."""

    store: str
    """Path of the store."""
    config: CampaignConfig
    """The campaign."""
    fingerprint: str
    """Of the campaign's configuration."""
    runtime: Mapping[str, Any]
    """Versions and machine, as the store recorded them."""
    certification: Certification
    """What it rests on."""
    lines: tuple[Line, ...]
    """Every quantity that is shown."""
    holds: tuple[Hold, ...]
    """How the waveform and the references hold the switches; () where the model does not tell."""
    date: str
    """When it was written, UTC."""

    @property
    def best(self) -> Certified:
        """The waveform that is signed for."""
        return self.certification.best

    @property
    def verdict(self) -> LineVerdict:
        """fail where any limit fails, pass where all pass; not judged without limits."""
        found = {line.verdict for line in self.lines} - {"not judged"}
        for verdict in ("fail", "not established", "pass"):
            if verdict in found:
                return cast(LineVerdict, verdict)
        return "not judged"

    @property
    def n_limits(self) -> int:
        """How many limits the verdict rests on."""
        return sum(line.limit is not None for line in self.lines)

    @property
    def warnings(self) -> list[str]:
        """What a reader has to know whatever the verdict: many switches left open, hardly held."""
        return [*filter(None, [self.best.assessment.open_warning, hold_warning(self.holds)])]

    @property
    def unshaped(self) -> Certified | None:
        """The plain step on the same switches."""
        return next((r for r in self.certification.references if r.name == UNSHAPED), None)


class LimitsFile(BaseModel):
    """A file of limits: a quantity and its limit, each."""

    model_config = ConfigDict(extra="allow", allow_inf_nan=False)
    __pydantic_extra__: dict[str, Number]


def parsed_limits(texts: Sequence[str], table: Mapping[str, Any] | None = None) -> dict[str, float]:
    """Limits by quantity, from texts such as `v_u=20`, `p_nc=5%`, and a table of a file, which they override.

    Raises SignError for what is no quantity, none that a certificate tells, or no number.
    """
    found = dict(checked(LimitsFile, table or {}, SignError).__pydantic_extra__ or {})
    for text in texts:
        name, equals, number = text.partition("=")
        share = number.strip().endswith("%")
        try:
            value = float(number.strip().removesuffix("%"))
        except ValueError:
            value = math.nan
        if not equals or not math.isfinite(value):
            raise SignError(f"limit {text!r} is not NAME=NUMBER; give, for example, v_u=20 or p_nc=5%")
        if share and name.strip() in QUANTITIES and not quantity(name.strip()).is_share:
            unit = quantity(name.strip()).unit
            raise SignError(
                f"limit {text!r} is in per cent; {name.strip()} is {'a number' if unit == '1' else f'in {unit}'}"
            )
        found[name.strip()] = value / 100.0 if share else value
    allowed = [name for name in QUANTITIES if name not in ASK_IMPACTS]
    for name in found:
        if name not in allowed:
            raise SignError(f"{name!r} has no limit here; {did_you_mean(name, allowed)}known: {', '.join(allowed)}")
    return found


def sign(path: str, limits: Mapping[str, float]) -> Sheet:
    """Hold the best certified waveform of a store against limits, on the switches of the certificate that counts.

    limits: by quantity, in its unit. Raises SignError where nothing is certified, or the campaign went on since.
    """
    campaign = open_campaign(path)
    certification = read_certification(path)
    if certification is None:
        raise SignError(f"{path} has no certificate: run `softclose certify {path}` first, a sign-off rests on it")
    if certification.committed < campaign.committed:
        raise SignError(
            f"{path} has {campaign.committed} candidates, and {certification.committed} when it was certified: run "
            f"`softclose certify {path}` again"
        )
    config = CampaignConfig.from_dict(campaign.config)
    best = certification.best
    lot = fresh_switches(config, certification.n_switches, seed=certification.seed)
    closing = Closing.of(config, lot, best.waveform, cast(Responses, best.response))
    shown = [name for name in SHOWN if name in limits or name not in UNTOLD or best.contacts]
    names = [*shown, *(name for name in limits if name not in SHOWN)]
    return Sheet(
        store=path,
        config=config,
        fingerprint=campaign.fingerprint,
        runtime=campaign.runtime,
        certification=certification,
        lines=tuple(_line(quantity(name), closing, limits.get(name)) for name in names),
        holds=holds_of(config, certification),
        date=time.strftime("%Y-%m-%d", time.gmtime()),
    )


def _line(q: Quantity, closing: Closing, limit: float | None) -> Line:
    try:
        value = q.of(closing)
    except QuantityError as e:
        raise SignError(f"{q.name} cannot be told from a certificate: {e}") from e
    return Line(quantity=q, value=value, limit=limit, verdict=verdict_of(q, value, limit))


def waveform_digest(waveform: Waveform) -> str:
    """sha256 of the rows of start, rise, flat top and volts as JSON, null where the last pulse holds.

    `hashlib.sha256(json.dumps(rows).encode())` of the rows in the sheet's JSON gives the same.
    """
    return hashlib.sha256(json.dumps(waveform_rows(waveform.rows())).encode()).hexdigest()


def versions_of(sheet: Sheet) -> dict[str, str]:
    """Versions that the campaign last ran with, by package; this one's own name is that of the program that signs."""
    runs = sheet.runtime.get("runs") or [sheet.runtime]
    found = {str(k): str(v) for k, v in (runs[-1].get("versions") or {}).items()}
    return found | {"softclose (this page)": __version__}


def sheet_to_json(sheet: Sheet) -> dict[str, Any]:
    """One object for a release process; undefined numbers are null."""
    best, c = sheet.best, sheet.certification
    plain: dict[str, Any] = finite(
        {
            "verdict": sheet.verdict,
            "warning": best.assessment.open_warning,
            "hold_warning": hold_warning(sheet.holds),
            "hold": [hold.to_dict() for hold in sheet.holds],
            "limits": [
                {
                    "quantity": line.quantity.name,
                    "what": line.quantity.long_name,
                    "unit": line.quantity.unit,
                    "value": line.value.estimate,
                    "interval": list(line.value.interval),
                    "n_switches": line.value.n,
                    "limit": line.limit,
                    "better": line.quantity.better,
                    "verdict": line.verdict,
                }
                for line in sheet.lines
            ],
            "open": open_kinds(best.response, best.assessment.closed_by_us).to_dict(),
            "drive_off": drive_off_to_json(c.drive_off),
            "confidence": best.assessment.confidence,
            "level": best.assessment.level,
            "candidate": best.candidate,
            "waveform": waveform_rows(best.waveform.rows()),
            "waveform_sha256": waveform_digest(best.waveform),
            "fresh_switches": c.n_switches,
            "fresh_seed": c.seed,
            "campaign": sheet.config.campaign.name,
            "population": sheet.config.population.name,
            "fingerprint": sheet.fingerprint,
            "store": sheet.store,
            "assumptions": assumptions(sheet.config),
            "versions": versions_of(sheet),
            "date": sheet.date,
        }
    )
    return plain
