"""Owns how certifications are kept in a store: side by side, one group for each number of switches and seed.

The one on the most switches counts, wherever one is asked for. See docs/adr/047-certificates-side-by-side.md.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from softclose.conditions.streams import Ensemble
from softclose.evaluate.asked import asked
from softclose.evaluate.quantities import Quantity
from softclose.population.lot import COLUMNS, Lot
from softclose.settings import CampaignConfig
from softclose_store import (
    Campaign,
    DamageError,
    GroupArray,
    ResultGroup,
    group_attributes,
    list_groups,
    open_campaign,
    read_group,
    write_group,
)
from softclose_workflows.analyses.certification import (
    Certification,
    CertifyError,
    Request,
    assemble,
)
from softclose_workflows.analyses.drive_off import DriveOff, drive_off_of
from softclose_workflows.analyses.judged_arrays import figure_arrays, response_arrays, response_of
from softclose_workflows.run import records
from softclose_workflows.run.opening import opening_arrays, openings_of

GROUP = "certification"
"""Group of the store that holds the certifications; a store of version 0.1 has its only one here."""


OFF = "off_"
"""What arrays of the best candidate under drives that are a little off begin with."""
_NAME = re.compile(rf"{GROUP}/(\d+)-(\d+)")


def name_of(n_switches: int, seed: int) -> str:
    """The group of the certification on so many switches of that seed."""
    return f"{GROUP}/{n_switches}-{seed}"


def certificate_names(path: str) -> list[str]:
    """Groups of the certifications of a store: the one that counts first.

    Most switches first; of equally many the one that saw most of the campaign, then the one of smallest seed.
    """
    names = [name for name in list_groups(path, GROUP) if name == GROUP or _NAME.fullmatch(name)]
    if len(names) < 2:
        return names
    requests = {name: _numbers(path, name) for name in names}
    return sorted(names, key=lambda name: requests[name])


def _numbers(path: str, name: str) -> tuple[int, int, int]:
    """What certifications are sorted by, smallest first; a damaged one has its name."""
    attributes = group_attributes(path, name) or {}
    in_name = _NAME.fullmatch(name)
    said = [attributes.get(key) for key in ("n_switches", "committed", "seed")]
    n, committed, seed = (value if isinstance(value, int) else 0 for value in said)
    if in_name:
        n, seed = map(int, in_name.groups())
    return -n, -committed, seed


def read_certification(path: str) -> Certification | None:
    """The certification that counts in a store; None where there is none. Raises DamageError where it is damaged."""
    names = certificate_names(path)
    return read_certificate(path, names[0]) if names else None


def read_certificate(path: str, name: str) -> Certification:
    """The certification in one group; raises StoreMissingError or DamageError."""
    group = read_group(path, name)
    campaign = open_campaign(path)
    try:
        return _certification(campaign, group)
    except (KeyError, IndexError, TypeError, AttributeError, CertifyError) as e:
        raise DamageError(
            f"group {name} of {path} is no certification ({type(e).__name__}: {e}): run `softclose verify {path} "
            "--repair`, or delete that group"
        ) from e


def _certification(campaign: Campaign, group: ResultGroup) -> Certification:
    config = CampaignConfig.from_dict(campaign.config)
    a = group.arrays
    names = [str(name) for name in a["design"]]
    further = asked(config)
    waveforms = {name: records.unpadded(rows) for name, rows in zip(names, a["waveform"], strict=True)}
    responses = {name: response_of(a, i, further) for i, name in enumerate(names)}
    result = assemble(campaign, config, waveforms, responses, request_of(group.attributes))
    gains = a["drive_gain"].tolist() if "drive_gain" in a else []
    off = tuple(drive_off_of(config, gain, response_of(a, k, further, OFF)) for k, gain in enumerate(gains))
    return replace(result, openings=openings_of(config, a), drive_off=off)


def request_of(attributes: Mapping[str, Any]) -> Request:
    """What a certification follows from, as its group's attributes say; raises CertifyError where they do not."""
    try:
        return Request(
            n_switches=int(attributes["n_switches"]),
            seed=int(attributes["seed"]),
            top=int(attributes["top"]),
            committed=int(attributes["committed"]),
            incumbent=int(attributes["incumbent"]),
            candidates=tuple(int(i) for i in attributes["candidates"]),
            missing={str(name): str(why) for name, why in attributes["missing"].items()},
        )
    except (KeyError, TypeError, ValueError, AttributeError) as e:
        raise CertifyError(f"the group does not say what it certified ({e!r}); certify again") from e


def write_certificate(path: str, result: Certification, lot: Lot | None) -> None:
    """Store the per-switch results, from which everything else follows, and the figures beside them for any reader.

    lot: the new switches, whose properties are stored too: a reader need not know how they are drawn; None where they
    are devices of which nobody knows them.
    """
    designs = [*result.candidates, *result.references]

    arrays = {
        "design": GroupArray(dims=("design",), values=np.array([d.name for d in designs]), long_name="design"),
        "candidate": GroupArray(
            dims=("design",),
            values=np.array([-1 if d.candidate is None else d.candidate for d in designs]),
            long_name="index in the campaign; -1: a reference design",
        ),
        "waveform": GroupArray(
            dims=("design", "pulse", "parameter"),
            values=records.padded_rows([d.waveform for d in designs]),
            unit="µs or V",
            long_name="start, rise, peak, volts; a peak of inf holds, rows of NaN are absent",
        ),
        "parameter": records.parameters(),
        "training_g_cm_s": GroupArray(
            dims=("design",),
            unit="cm/s",
            long_name="g on the training ensemble",
            values=np.array([math.nan if d.training is None else d.training.g_cm_s for d in designs]),
        ),
        "training_n_switches": GroupArray(
            dims=("design",),
            long_name="size of the training ensemble; 0: a reference design",
            values=np.array([0 if d.training is None else d.training.n_switches for d in designs]),
        ),
    }
    further = asked(CampaignConfig.from_dict(open_campaign(path).config))
    arrays |= response_arrays([d.response for d in designs], ("design", "fresh_switch"), further)
    arrays |= figure_arrays([(d.assessment, {**d.values, **d.contacts}) for d in designs], "design")
    if result.drive_off:
        arrays |= _drive_off_arrays(result.drive_off, further)
    limits = [e.limit_cm_s for e in result.best.assessment.p_exceed]
    arrays["limit"] = GroupArray(dims=("limit",), values=np.array(limits), unit="cm/s", long_name="contact-speed limit")
    if result.openings is not None:
        arrays |= opening_arrays(result.openings, "fresh_switch")
    arrays["fresh_switch"] = GroupArray(
        dims=("fresh_switch",),
        values=np.arange(designs[0].response.closed.size),
        long_name="index of the fresh switch, which is none of the campaign's",
    )
    if lot is not None:
        arrays |= {
            c.name: GroupArray(dims=("fresh_switch",), values=lot[c.name], unit=c.unit, long_name=c.long_name)
            for c in map(COLUMNS.__getitem__, lot)
        }
    request = result.request
    write_group(
        path,
        name_of(request.n_switches, request.seed),
        arrays,
        {
            **asdict(request),
            "stream": int(Ensemble.CERTIFICATE),
            "sampling": "monte-carlo",
            "limits_cm_s": limits,
            "level": result.best.assessment.level,
            "confidence": result.best.assessment.confidence,
        },
        replace=True,
    )


def _drive_off_arrays(rows: Sequence[DriveOff], further: Sequence[Quantity]) -> dict[str, GroupArray]:
    """What the first new switches do under the best candidate where the drive is off, and its figures."""
    n = rows[0].response.closed.size
    return {
        "drive_gain": GroupArray(
            dims=("drive_gain",),
            values=np.array([row.gain for row in rows]),
            long_name="relative error of the drive's volts, of the best candidate",
        ),
        "off_switch": GroupArray(
            dims=("off_switch",), values=np.arange(n), long_name="index of the fresh switch, of the first ones"
        ),
        **response_arrays([row.response for row in rows], ("drive_gain", "off_switch"), further, OFF),
        **figure_arrays([(row.assessment, {}) for row in rows], "drive_gain", OFF),
    }
