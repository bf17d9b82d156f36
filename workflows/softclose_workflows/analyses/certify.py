"""Owns certification: the out-of-sample truth about a campaign's best candidates, kept in its store.

A campaign picks the smallest of many noisy values of g, so its training score is optimistic. The new switches have a
random stream of their own, so that no seed can make them the training ensemble again; they are independent random
draws, so Eq. 11 and its companions hold whatever the campaign's own sampling is. See docs/adr/045-certification.md.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from softclose.arrays import FloatArray
from softclose.conditions.streams import Ensemble
from softclose.evaluate import draw, respond
from softclose.evaluate.gathered import Gathering
from softclose.evaluate.pieces import Mapper, Sent, here, light, rows_of_pieces
from softclose.metrics.intervals import least_for_quantile_interval
from softclose.metrics.objective import Judged
from softclose.metrics.ranking import is_beyond
from softclose.opening import WATCHED, Opening, OpeningError, Openings, Released, assess_opening, joined, let_go
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.waveform import Drive, Waveform
from softclose_store import Campaign, StoreMissingError, open_campaign
from softclose_workflows.analyses.certificates import name_of, read_certificate, request_of, write_certificate
from softclose_workflows.analyses.certificates import read_certification as read_certification
from softclose_workflows.analyses.certification import Certification as Certification
from softclose_workflows.analyses.certification import Certified as Certified
from softclose_workflows.analyses.certification import CertifyError as CertifyError
from softclose_workflows.analyses.certification import Request, assemble, candidate_name
from softclose_workflows.analyses.certification import assess_fresh as assess_fresh
from softclose_workflows.analyses.distinct import distinct
from softclose_workflows.analyses.drive_off import MOST, off_by_drive
from softclose_workflows.analyses.kept_certificates import designs_of, keep_designs, releases_of
from softclose_workflows.analyses.references import reference_designs
from softclose_workflows.run import needs
from softclose_workflows.run.opening import designed_opening
from softclose_workflows.tell.console import OnStep

N_REFERENCES = 2
"""Reference designs at most."""

MANY = 200_000
"""New switches from which on they are drawn by whoever simulates: fewer take this process less than a second."""

DISTINCT_VOLTS = 0.25
"""Waveforms whose voltages differ by less than this (root mean square over the horizon) count as one."""


def certify(
    path: str,
    *,
    n_switches: int = 100_000,
    seed: int | None = None,
    top: int = 10,
    store_trajectories: bool = False,
    mapper: Mapper = here,
    listener: OnStep | None = None,
) -> Certification:
    """Certify the `top` best distinct candidates of the campaign at path, and keep the result in its group.

    seed: of the new switches; the campaign's own by default (their stream differs). Certifications on other numbers
    of switches, or of other seeds, stay as they are. What was certified before on these very switches stays certified:
    only candidates that are new among the best are simulated. store_trajectories: x(t) and v(t) of every new switch
    under every design are kept, too (`kept_certificates`). Raises CertifyError.
    """
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    check_size(config, n_switches, top)
    seed = config.campaign.seed if seed is None else seed
    incumbent, chosen = choose_distinct(campaign, config, top)
    stored = _stored(path, name_of(n_switches, seed))
    known = () if stored is None else stored.request.candidates
    unchanged = stored is not None and (stored.incumbent, stored.committed) == (incumbent, campaign.committed)
    if stored is not None and stored.is_whole and unchanged and {*chosen} <= {*known}:
        if store_trajectories:
            keep_certificate(path, config, stored, mapper=mapper, listener=listener)
        return stored
    n_designs = len({*chosen, *known}) + N_REFERENCES
    needs.check_fresh(n_switches, n_designs, path=path, kept=config if store_trajectories else None)
    references = reference_designs(config)
    request = Request(
        n_switches=n_switches,
        seed=seed,
        top=top if stored is None else max(top, stored.request.top),
        committed=campaign.committed,
        incumbent=incumbent,
        candidates=tuple(sorted({*chosen, *known})),
        missing=references.missing,
    )
    designs = () if stored is None or not stored.is_whole else (*stored.candidates, *stored.references)
    have = {d.name: d.response for d in designs}
    if store_trajectories:
        have |= keep_request(campaign, config, request, mapper=mapper, listener=listener)
    result = certified_on(campaign, config, request, have, mapper=mapper, listener=listener)
    write_certificate(path, result, drawn_fresh(config, n_switches, seed=seed, mapper=mapper))
    if store_trajectories:
        keep_releases(path, config, result, mapper=mapper)
    return result


def keep_certificate(
    path: str, config: CampaignConfig, result: Certification, *, mapper: Mapper = here, listener: OnStep | None = None
) -> None:
    """Keep every trajectory behind a certificate that is there."""
    keep_request(open_campaign(path), config, result.request, mapper=mapper, listener=listener)
    keep_releases(path, config, result, mapper=mapper)


def keep_request(
    campaign: Campaign,
    config: CampaignConfig,
    request: Request,
    *,
    mapper: Mapper = here,
    listener: OnStep | None = None,
) -> dict[str, Judged]:
    """Keep the trajectories of the designs that a request stands for; what is judged of those simulated for it."""
    waveforms, references = _designs(campaign, config, request)
    designs = designs_of(waveforms | references, request.n_switches, for_everybody=references)
    return keep_designs(campaign.path, config, designs, seed=request.seed, mapper=mapper, listener=listener)


def keep_releases(path: str, config: CampaignConfig, result: Certification, *, mapper: Mapper = here) -> None:
    """Keep the trajectories of the openings of a certificate."""
    best = result.best.candidate
    if best is not None:
        released = releases_of(result.openings, best, result.n_switches)
        keep_designs(path, config, released, seed=result.seed, mapper=mapper)


def _designs(
    campaign: Campaign, config: CampaignConfig, request: Request
) -> tuple[dict[str, Waveform], dict[str, Waveform]]:
    """The candidates and the reference designs of a request, by name."""
    waveforms = {candidate_name(i): Waveform.from_rows(campaign.waveform(i)) for i in request.candidates}
    return waveforms, reference_designs(config).designs


def certify_again(path: str, name: str, attributes: Mapping[str, Any] | None) -> None:
    """Compute the certification in group `name` again, from what it was asked for and the campaign, and write it.

    For the repair of a group whose arrays are damaged.

    Parameters
    ----------
    path : str
        Folder or URL of the store.
    name : str
        Such as `certification/20000-0`.
    attributes : mapping or None
        Those of the group; None where nothing says them any more.

    Raises
    ------
    CertifyError
        Where that does not say what was certified, or the campaign has not come as far again.
    """
    if attributes is None:
        raise CertifyError(
            f"{name} of {path} does not say any more what was certified: delete that group and run `softclose certify`"
        )
    request = request_of(attributes)
    if name != name_of(request.n_switches, request.seed):
        raise CertifyError(f"{name} of {path} is a certification of version 0.1: delete it and certify again")
    campaign = open_campaign(path)
    if campaign.committed < request.committed:
        raise CertifyError(
            f"{name} of {path} certified candidates of {request.committed}, but {campaign.committed} are committed: "
            "finish the campaign (softclose resume), then certify again"
        )
    config = CampaignConfig.from_dict(campaign.config)
    fresh = drawn_fresh(config, request.n_switches, seed=request.seed)
    write_certificate(path, certified_on(campaign, config, request, {}), fresh)


def least_switches(config: CampaignConfig) -> int:
    """Fewest new switches that may certify this campaign.

    As many as the largest ensemble that its candidates were tuned on: fewer know less than the campaign did. And as
    many as bound v_u from above at the campaign's level and confidence (36 at 90 % and 95 %).
    """
    o = config.objective
    return max(config.n_switches_max, least_for_quantile_interval(o.level, o.confidence))


def check_size(config: CampaignConfig, n_switches: int, top: int) -> None:
    """Raise CertifyError where so few switches or candidates certify nothing."""
    if top < 1:
        raise CertifyError(f"{top} candidates are to be certified; at least 1 is needed (--top)")
    least = least_switches(config)
    if n_switches < least:
        raise CertifyError(
            f"{n_switches} new switches certify nothing here: at least {least} are needed, as many as the campaign "
            f"chose its candidates on ({config.n_switches_max}) and as its interval of v_u asks for (--switches)"
        )


def _stored(path: str, name: str) -> Certification | None:
    """What is certified there; None where nothing is. What is damaged says no more which candidates it had."""
    try:
        return read_certificate(path, name)
    except StoreMissingError:
        return None


def certified_on(
    campaign: Campaign,
    config: CampaignConfig,
    request: Request,
    have: dict[str, Judged],
    *,
    mapper: Mapper = here,
    listener: OnStep | None = None,
) -> Certification:
    """The certification that a request stands for; have: responses of designs that are known already."""
    waveforms, references = _designs(campaign, config, request)
    waveforms |= references
    new = {name: waveform for name, waveform in waveforms.items() if name not in have}
    responses = simulate_fresh(
        config,
        list(new.values()),
        n_switches=request.n_switches,
        seed=request.seed,
        for_everybody=[i for i, name in enumerate(new) if name in references],
        mapper=mapper,
        listener=listener,
    )
    result = assemble(campaign, config, waveforms, have | dict(zip(new, responses, strict=True)), request)
    best, lot = result.best, fresh_switches(config, min(request.n_switches, MOST), seed=request.seed)
    return replace(
        result,
        openings=_openings(campaign, config, result, mapper),
        drive_off=off_by_drive(config, lot, best.waveform, best.response, mapper=mapper),
    )


def _openings(campaign: Campaign, config: CampaignConfig, result: Certification, mapper: Mapper) -> Openings | None:
    """The best candidate's designed opening on the new switches, a part at a time; None where nothing can be said."""
    best = result.best.candidate
    try:
        designed = None if best is None else designed_opening(campaign.path, best, mapper=mapper)
    except OpeningError:
        return None
    if designed is None:
        return None

    sent = Sent(config)

    def on_fresh(waveform: Waveform) -> Opening:
        n, seed = result.n_switches, result.seed
        cut = [range(start, min(start + WATCHED, n)) for start in range(0, n, WATCHED)]
        parts = [FreshRelease(sent, seed, rows, waveform, designed.at_us) for rows in cut]
        return assess_opening(config, joined(list(mapper(_let_go_fresh, parts))))

    return Openings(
        at_us=designed.at_us,
        plain=on_fresh(designed.plain.released.waveform),
        braked=None if designed.braked is None else on_fresh(designed.braked.released.waveform),
    )


def fresh_switches(config: CampaignConfig, n: int, *, seed: int, start: int = 0) -> Lot:
    """Switches `start` to `start + n` of the certification ensemble `seed`, as `softclose.evaluate.draw` gives them."""
    return draw(config, n, seed=seed, start=start, ensemble=Ensemble.CERTIFICATE)


def drawn_fresh(config: CampaignConfig, n: int, *, seed: int, mapper: Mapper = here) -> Lot:
    """`fresh_switches` of the first n, a piece at a time. mapper: who draws, where they are many."""
    parts = (mapper if n > MANY else here)(_drawn_fresh, fresh_pieces(config, n, seed=seed))
    columns: dict[str, FloatArray] = {}
    area, start = None, 0
    for part in parts:
        for name in part:
            columns.setdefault(name, np.empty(n))[start : start + len(part)] = part[name]
        area, start = part.plate_area_um2, start + len(part)
    return Lot(columns, plate_area_um2=area)


def fresh_pieces(config: CampaignConfig, n: int, *, seed: int, drives: Sequence[Drive] = (),
    for_everybody: Collection[int] = (), start: int = 0, n_waveforms: int = 1) -> list[FreshSwitches]:  # fmt: skip
    """Switches `start` to `start + n` of the certification ensemble `seed` as pieces, each under all the drives.

    n_waveforms: how many trajectories of a switch a piece is as much work as.
    """
    sent, whole = Sent(config), frozenset(for_everybody)
    return [
        FreshSwitches(sent, seed, range(start + r.start, start + r.stop), tuple(drives), whole)
        for r in rows_of_pieces(config, n, n_waveforms=n_waveforms)
    ]


def simulate_fresh(
    config: CampaignConfig,
    waveforms: Sequence[Drive],
    *,
    n_switches: int,
    seed: int,
    start: int = 0,
    for_everybody: Collection[int] = (),
    mapper: Mapper = here,
    listener: OnStep | None = None,
) -> list[Judged]:
    """Metrics of every waveform on the same new switches of the campaign's lot, `start` and on, a piece at a time.

    for_everybody: the waveforms that are tailored to no switch, whatever the campaign measures. mapper: who simulates.
    """
    if not waveforms:
        return []
    pieces = fresh_pieces(
        config, n_switches, seed=seed, drives=waveforms, for_everybody=for_everybody, start=start,
        n_waveforms=len(waveforms),
    )  # fmt: skip
    gathering = Gathering(len(waveforms), n_switches)
    for piece, found in zip(pieces, mapper(_simulate_fresh, pieces), strict=True):
        for i, part in enumerate(found):
            gathering.put(i, piece.rows.start - start, part)
        if listener is not None:
            listener((piece.rows.stop - start) * len(waveforms), n_switches * len(waveforms))
    return gathering.judged()


@dataclass(frozen=True, slots=True)
class FreshSwitches:
    """Rows of a certification ensemble under waveforms: a piece of certifying."""

    sent: Sent
    seed: int
    rows: range
    drives: tuple[Drive, ...]
    for_everybody: frozenset[int]

    @property
    def lot(self) -> Lot:
        """Those switches, drawn."""
        return fresh_switches(self.sent.config, len(self.rows), seed=self.seed, start=self.rows.start)


@dataclass(frozen=True, slots=True)
class FreshRelease:
    """Rows of a certification ensemble that are let go."""

    sent: Sent
    seed: int
    rows: range
    waveform: Waveform
    at_us: float


def _drawn_fresh(piece: FreshSwitches) -> Lot:
    return piece.lot


def _simulate_fresh(piece: FreshSwitches) -> list[Judged]:
    """What is judged of the rows under each drive."""
    config, switches = piece.sent.config, piece.lot
    return [
        light(respond(config, switches, drive, for_everybody=i in piece.for_everybody))
        for i, drive in enumerate(piece.drives)
    ]


def _let_go_fresh(piece: FreshRelease) -> Released:
    config = piece.sent.config
    switches = fresh_switches(config, len(piece.rows), seed=piece.seed, start=piece.rows.start)
    return let_go(config, switches, piece.waveform, at_us=piece.at_us)


def choose_distinct(campaign: Campaign, config: CampaignConfig, top: int) -> tuple[int, list[int]]:
    """The incumbent, and the best distinct candidates: the incumbent first, then by rank, g plus its standard error.

    The standard error stands for the size of the ensemble: g estimated on few switches is optimistic.
    """
    best = campaign.best()
    if best is None:
        raise CertifyError(f"{campaign.path} has no usable candidate yet: let the campaign run, then certify")
    table = campaign.records()
    rank, error = table["rank_cm_s"], np.nan_to_num(table["g_se_cm_s"])
    promise = np.where(table["failed"], math.inf, np.where(is_beyond(rank), rank, rank + error))
    order = [best.candidate, *(int(i) for i in np.argsort(promise, kind="stable") if np.isfinite(promise[i]))]
    chosen = distinct(
        order,
        lambda i: Waveform.from_rows(campaign.waveform(i)),
        until_us=config.model.horizon_us,
        apart_V=DISTINCT_VOLTS,
        most=top,
    )
    return best.candidate, chosen
