"""Owns the trajectories behind a certificate, kept where somebody asks for them: a group for each design.

A group is named after the switches and the design and follows from both and the campaign, so what is there is right:
further candidates add their own, and a certificate on more switches leaves them alone.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softclose.conditions.streams import Ensemble
from softclose.device.cost import rows_a_piece
from softclose.evaluate import counted, draw, respond_each
from softclose.evaluate.pieces import Mapper, Sent, here, joined_judged, light
from softclose.metrics.objective import Judged
from softclose.opening import WATCHED, Openings, looks_us, watched
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store import GroupArray, open_campaign
from softclose_workflows.analyses.certification import candidate_of
from softclose_workflows.analyses.references import reference_designs
from softclose_workflows.run.opening import designed_opening
from softclose_workflows.run.records import padded_rows, parameters
from softclose_workflows.run.releases import looks_of
from softclose_workflows.run.tasks import times_us
from softclose_workflows.run.trajectories import GROUP, Keeper, has_group, motion_of, outputs_of, rows_of_parts
from softclose_workflows.tell.console import OnStep

_NAME = re.compile(rf"{GROUP}/certification-(\d+)-(\d+)/([a-z]+|candidate-\d+|release-\d+-(?:plain|braked))")
_RELEASED = re.compile(r"release (\d+) (plain|braked)")


def name_of(n_switches: int, seed: int, design: str) -> str:
    """The group of one design's trajectories on so many new switches of that seed."""
    return f"{GROUP}/certification-{n_switches}-{seed}/{design.replace(' ', '-')}"


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptDesign:
    """A drive whose trajectories are kept."""

    name: str
    """`candidate 17`, `unshaped`, …; `release 17 braked` for the opening of a candidate."""
    waveform: Waveform
    """What is applied."""
    n_switches: int
    """New switches that it is applied to, the first ones."""
    for_everybody: bool = False
    """See `softclose.evaluate.respond`."""
    release_us: float | None = None
    """Begin of the fall, where an opening is watched [µs]."""


def designs_of(
    waveforms: Mapping[str, Waveform], n_switches: int, *, for_everybody: Collection[str] = ()
) -> list[KeptDesign]:
    """The designs of a certificate."""
    return [
        KeptDesign(name=name, waveform=w, n_switches=n_switches, for_everybody=name in for_everybody)
        for name, w in waveforms.items()
    ]


def releases_of(openings: Openings | None, candidate: int, n_switches: int) -> list[KeptDesign]:
    """The openings of a certificate."""
    if openings is None:
        return []
    each = {"plain": openings.plain, "braked": openings.braked}
    return [
        KeptDesign(
            name=f"release {candidate} {kind}",
            waveform=o.released.waveform,
            n_switches=n_switches,
            release_us=openings.at_us,
        )
        for kind, o in each.items()
        if o is not None
    ]


def keep_designs(
    path: str,
    config: CampaignConfig,
    designs: Sequence[KeptDesign],
    *,
    seed: int,
    mapper: Mapper = here,
    listener: OnStep | None = None,
) -> dict[str, Judged]:
    """Keep the trajectories of those designs whose are not there yet.

    Returns what is judged of the designs that were simulated for it, by name; of openings nothing.
    """
    wanted = [d for d in designs if not has_group(path, name_of(d.n_switches, seed, d.name))]
    return _keep(path, config, wanted, seed=seed, mapper=mapper, listener=listener)


def keep_again(path: str, group: str) -> str:
    """Keep the trajectories of one group again. Returns why not; empty where it is done."""
    config = CampaignConfig.from_dict(open_campaign(path).config)
    match = _NAME.fullmatch(group)
    design = None if match is None else _design_of(path, config, int(match[1]), match[3].replace("-", " "))
    if match is None or design is None:
        return f"{group} of {path} belongs to nothing that `softclose certify` keeps: delete that group"
    _keep(path, config, [design], seed=int(match[2]), mapper=here, listener=None)
    return ""


def _design_of(path: str, config: CampaignConfig, n: int, name: str) -> KeptDesign | None:
    i, released = candidate_of(name), _RELEASED.fullmatch(name)
    campaign = open_campaign(path)
    if i is not None:
        waveform = Waveform.from_rows(campaign.waveform(i)) if i < campaign.committed else None
        return None if waveform is None else KeptDesign(name=name, waveform=waveform, n_switches=n)
    if released is not None:
        designed = designed_opening(path, int(released[1]))
        return next((d for d in releases_of(designed, int(released[1]), n) if d.name == name), None)
    reference = reference_designs(config).designs.get(name)
    return None if reference is None else KeptDesign(name=name, waveform=reference, n_switches=n, for_everybody=True)


def _keep(
    path: str,
    config: CampaignConfig,
    designs: Sequence[KeptDesign],
    *,
    seed: int,
    mapper: Mapper,
    listener: OnStep | None,
) -> dict[str, Judged]:
    sent = Sent(config)
    pieces: list[_Rows] = []
    for design in designs:
        n, is_release = design.n_switches, design.release_us is not None
        most = WATCHED if is_release else rows_a_piece(config.seconds_a_switch)
        rows = rows_of_parts(config, n, most=most, motions=config.n_cases)
        keeper = Keeper.of(
            config,
            path,
            name_of(n, seed, design.name),
            {"fresh_switch": rows},
            n_cases=config.n_cases,
            time="release_time" if is_release else "time",
            n_times=len(looks_of(config)) if is_release else config.store.n_times,
        )
        cut = [range(i, min(i + rows, n)) for i in range(0, n, rows)]
        pieces += [_Rows(sent, keeper, design, seed, part, own) for part, own in enumerate(cut)]
    judged: dict[str, list[Judged]] = {}
    files: dict[str, str] = {}
    done, whole = 0, sum(d.n_switches for d in designs)
    for piece, (found, kept) in zip(pieces, mapper(_simulate_and_keep, pieces), strict=True):
        files |= kept
        done += len(piece.rows)
        if found is not None:
            judged.setdefault(piece.design.name, []).append(found)
        if listener is not None:
            listener(done, whole)
        if piece.rows.stop == piece.design.n_switches:
            _finish(config, piece, files)
            files = {}
    return {name: joined_judged(parts) for name, parts in judged.items()}


@dataclass(frozen=True, slots=True)
class _Rows:
    """Rows of a certification ensemble under one design."""

    sent: Sent
    keeper: Keeper
    design: KeptDesign
    seed: int
    part: int
    rows: range


def _simulate_and_keep(piece: _Rows) -> tuple[Judged | None, dict[str, str]]:
    """What is judged of the rows, and the files that their motion went into."""
    config, design = piece.sent.config, piece.design
    lot = draw(config, len(piece.rows), seed=piece.seed, start=piece.rows.start, ensemble=Ensemble.CERTIFICATE)
    found: Judged | None = None
    if design.release_us is not None:
        _, each = watched(config, lot, design.waveform, design.release_us, further_modes=config.n_modes > 1)
        motion = motion_of(config, each, looks_of(config))
    else:
        each = respond_each(
            config,
            lot,
            design.waveform,
            for_everybody=design.for_everybody,
            times_us=times_us(config),
            **outputs_of(config),
        )
        motion, found = motion_of(config, each), light(counted(config, each))
    return found, piece.keeper.keep((piece.part,), motion)


def _finish(config: CampaignConfig, piece: _Rows, files: Mapping[str, str]) -> None:
    """All rows of the design of a piece, its last, are kept."""
    design, n = piece.design, piece.design.n_switches
    time = "time" if design.release_us is None else "release_time"
    instants = times_us(config) if design.release_us is None else looks_us(config)[looks_of(config)]
    piece.keeper.finish(
        config,
        (n,),
        files,
        {
            "fresh_switch": GroupArray(
                dims=("fresh_switch",),
                values=np.arange(n),
                long_name="index of the fresh switch, which is none of the campaign's",
            ),
            time: GroupArray(dims=(time,), values=instants, unit="µs", long_name="instants of the motion"),
            "parameter": parameters(),
            "waveform": GroupArray(
                dims=("pulse", "parameter"),
                values=padded_rows([design.waveform])[0],
                unit="µs or V",
                long_name="start, rise, peak, volts; a peak of inf holds",
            ),
        },
        {"design": design.name, "n_switches": n, "seed": piece.seed, "stream": int(Ensemble.CERTIFICATE)}
        | ({} if design.release_us is None else {"release_us": design.release_us}),
    )
