"""Owns the comparison of campaigns: the best design of each, and what was set differently."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from softclose.evaluate.pieces import Mapper, here
from softclose.metrics.objective import Judged
from softclose.metrics.paired import Comparison, compare
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose_store import open_campaign
from softclose_workflows.analyses.certify import assess_fresh, fresh_switches, simulate_fresh
from softclose_workflows.analyses.hold import Held, Hold, hold_warning, holds_on
from softclose_workflows.report.data import Design, ReportData
from softclose_workflows.report.gather import gather
from softclose_workflows.run.needs import check_fresh
from softclose_workflows.tell.labels import count
from softclose_workflows.tell.plain import waveform_rows


class CompareError(ValueError):
    """Campaigns that cannot be compared."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Entry:
    """One campaign in a comparison."""

    label: str
    """What tables and charts call it: unique."""
    data: ReportData
    design: Design | None
    """Its best candidate on new switches if it is certified, else on its own training switches; None without one."""
    fresh: Judged | None = None
    """What the new switches of this comparison did, where it has some."""
    hold: Hold | None = None
    """How its best candidate holds the switches that it is judged on; None where nothing is known of it."""

    @property
    def warnings(self) -> list[str]:
        """What a reader has to know beside the figures: many switches left open, hardly held."""
        held = hold_warning([self.hold]) if self.hold is not None else None
        left_open = "" if self.design is None else self.design.assessment.open_warning
        return [*filter(None, [left_open, held])]

    @property
    def is_fair(self) -> bool:
        """True where it is judged on switches that the search never saw."""
        return self.fresh is not None or self.data.certification is not None

    @property
    def basis(self) -> str:
        """What its figures come from."""
        if self.design is None:
            return "no usable candidate"
        n = count(self.design.assessment.n)
        return f"{n} new switches" if self.is_fair else f"{n} training switches"


def read_entries(paths: Sequence[str], fresh: int = 0, mapper: Mapper = here) -> list[Entry]:
    """Read every store. Raises CompareError where there are fewer than two.

    fresh: judge the best of each on so many new switches of its own population, the same ones where populations are
    the same; 0: as each store judges it. mapper: who simulates.
    """
    if len(paths) < 2:
        raise CompareError(f"got {len(paths)} store; give two or more to compare")
    found = [gather(path, learned=False, picks=False) for path in paths]
    names = [data.config.campaign.name for data in found]
    labels = [
        name if names.count(name) == 1 else f"{name} ({data.source})" for name, data in zip(names, found, strict=True)
    ]
    labels = [label if labels.count(label) == 1 else f"{label}, {k}" for k, label in enumerate(labels, start=1)]
    entries = [
        Entry(label=label, data=data, design=data.judged_designs[0] if data.judged_designs else None)
        for label, data in zip(labels, found, strict=True)
    ]
    seed = entries[0].data.config.campaign.seed
    if fresh:
        return [_on_fresh(entry, fresh, seed, mapper) for entry in entries]
    return [replace(entry, hold=_hold(entry, path)) for entry, path in zip(entries, paths, strict=True)]


def _hold(entry: Entry, path: str) -> Hold | None:
    """How the best candidate holds the switches of its certificate, or else those that it was trained on."""
    config, certification = entry.data.config, entry.data.certification
    if entry.design is None:
        return None
    if certification is not None:
        lot = fresh_switches(config, certification.n_switches, seed=certification.seed)
    else:
        lot = Lot(open_campaign(path).population()).rows(slice(len(entry.design.speed_cm_s)))
    return _held(entry, entry.design, lot, has_interval=certification is not None)


def _held(entry: Entry, design: Design, lot: Lot, *, has_interval: bool = True) -> Hold | None:
    asked = Held(name=f"candidate {entry.data.best}", waveform=design.waveform)
    return next(iter(holds_on(entry.data.config, lot, [asked], has_interval=has_interval)), None)


def _on_fresh(entry: Entry, n: int, seed: int, mapper: Mapper) -> Entry:
    if entry.design is None:
        return entry
    check_fresh(n, 1)
    config = entry.data.config
    (response,) = simulate_fresh(config, [entry.design.waveform], n_switches=n, seed=seed, mapper=mapper)
    old = entry.design
    design = Design.of(response, assess_fresh(response, config), name=old.name, role=old.role, waveform=old.waveform)
    lot = fresh_switches(config, n, seed=seed)
    return replace(entry, design=design, fresh=response, hold=_held(entry, design, lot))


def differences(entries: Sequence[Entry]) -> list[tuple[str, str, Comparison]]:
    """(label, label of the first, difference switch by switch) of each campaign against the first that it can be held
    against: of the same lot in the same device, behind the same amplifier, at the same temperatures."""
    found = []
    for k, entry in enumerate(entries):
        first = next((e for e in entries[:k] if not unlike(e.data.config, entry.data.config)), None)
        if first is None or first.fresh is None or entry.fresh is None or not first.design or not entry.design:
            continue
        pair = compare(
            (entry.fresh, entry.design.assessment),
            (first.fresh, first.design.assessment),
            entry.design.assessment.confidence,
        )
        found.append((entry.label, first.label, pair))
    return found


def unlike(a: CampaignConfig, b: CampaignConfig) -> list[str]:
    """What differs of all that has to be the same for two drives to be compared switch by switch; [] where nothing.

    A switch of another device under its own drive is no pair with it: one design may be softer on every switch because
    its switches are damped. How V is judged has to be the same, too.
    """
    named = ["population"] if a.population_model != b.population_model else []
    for section in ("model", "amplifier", "temperature"):
        own, other = (asdict(getattr(c, section)) for c in (a, b))
        named += [f"{section}.{key}" for key in own if own[key] != other[key] and (section, key) != ("model", "modes")]
    if a.reduced_order_model != b.reduced_order_model:
        named.append("model.modes")
    judged = ("level", "closed_by_us")
    return named + [f"objective.{key}" for key in judged if getattr(a.objective, key) != getattr(b.objective, key)]


def not_compared(entries: Sequence[Entry]) -> list[str]:
    """A sentence for each campaign on new switches that cannot be held against any before it, switch by switch."""
    said = []
    for k, entry in enumerate(entries[1:], start=1):
        apart = [unlike(e.data.config, entry.data.config) for e in entries[:k]]
        if entry.fresh is not None and all(apart):
            said.append(
                f"{entry.label} is not compared with {entries[0].label} switch by switch: they differ in "
                f"{', '.join(apart[0])}"
            )
    return said


def differing_settings(entries: Sequence[Entry]) -> list[tuple[str, list[str]]]:
    """(section.key, its value in each campaign) of every setting that is not the same in all of them."""
    flat = [_flat(entry.data.config.to_dict()) for entry in entries]
    keys = sorted({key for table in flat for key in table})
    rows = [(key, [_shown(table.get(key)) for table in flat]) for key in keys]
    return [(key, values) for key, values in rows if len(set(values)) > 1]


def _flat(config: dict[str, Any]) -> dict[str, Any]:
    return {
        f"{section}.{key}": value
        for section, table in config.items()
        if section != "population_model"  # follows from population.name, and fills a screen
        for key, value in table.items()
    }


def _shown(value: Any) -> str:
    return "–" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def comparison_to_json(entries: Sequence[Entry]) -> dict[str, Any]:
    """For scripts."""
    return {
        "campaigns": [_entry_to_json(entry) for entry in entries],
        "differences": [
            {"label": label, "against": first, **difference.to_dict()}
            for label, first, difference in differences(entries)
        ],
        "not_compared": not_compared(entries),
        "differing_settings": {
            key: dict(zip((entry.label for entry in entries), values, strict=True))
            for key, values in differing_settings(entries)
        },
    }


def _entry_to_json(entry: Entry) -> dict[str, Any]:
    data, found = entry.data, None
    if entry.design is not None:
        a = entry.design.assessment
        found = {
            "candidate": data.best,
            "g_cm_s": float(a.g_cm_s),
            "g_interval_cm_s": list(a.g_interval),
            "v_u_cm_s": float(a.v_u_cm_s),
            "v_u_interval_cm_s": list(a.v_u_interval),
            "mean_cm_s": float(a.mean_cm_s),
            "p_nc": float(a.p_nc),
            "p_nc_wilson": list(a.p_nc_intervals.wilson),
            "warning": a.open_warning,
            "hold": None if entry.hold is None else entry.hold.to_dict(),
            "hold_warning": hold_warning([entry.hold]) if entry.hold is not None else None,
            "n_switches": a.n,
            "certified": data.certification is not None,
            "fresh": entry.is_fair,
            "intervals_valid": a.intervals_valid,
            "waveform": waveform_rows(entry.design.waveform.rows()),
        }
    return {
        "label": entry.label,
        "store": data.source,
        "fingerprint": data.fingerprint,
        "seed": data.config.campaign.seed,
        "population": data.config.population.name,
        "space": data.config.waveform.space,
        "engine": data.config.optimiser.engine,
        "committed": data.n_committed,
        "budget": data.n_total,
        "best": found,
    }
