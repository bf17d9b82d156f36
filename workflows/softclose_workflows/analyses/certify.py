"""Owns certification: the out-of-sample truth about a campaign's best candidates, kept in its store.

A campaign picks the smallest of many noisy values of g, so its optimum flatters itself. The fresh switches have a
random stream of their own, so that no seed can make them the training ensemble again; they are independent random
draws, so Eq. 11 and its companions hold whatever the campaign's own sampling is. See docs/adr/045-certification.md.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.config import CampaignConfig
from softclose.evaluate import judge
from softclose.metrics.objective import Assessment, Judged
from softclose.metrics.paired import Comparison, compare
from softclose.population import Population
from softclose.waveform import FloatArray, Waveform
from softclose_store import (
    Campaign,
    DamageError,
    GroupArray,
    StoreMissingError,
    open_campaign,
    read_group,
    write_group,
)
from softclose_workflows.run import needs, records
from softclose_workflows.tell.console import Step

GROUP = "certification"
"""Result group of the store."""

STREAM = 1
"""Random stream of certification ensembles; campaigns train on stream 0."""

CHUNK = 10_000
"""Switches simulated between two looks at the progress."""

N_REFERENCES = 2
"""Reference designs at most."""

DISTINCT_VOLTS = 0.25
"""Waveforms whose voltages differ by less than this (root mean square over the horizon) count as one."""


class CertifyError(ValueError):
    """A certification that cannot be made."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Training:
    """What the campaign believed of a candidate."""

    g_cm_s: float
    """Objective on the training ensemble [cm/s]."""
    v_u_cm_s: float
    """Upper velocity there [cm/s]."""
    p_nc: float
    """Fraction not closed there."""
    n_switches: int
    """Size of that ensemble."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Certified:
    """One waveform on the fresh switches."""

    name: str
    """`candidate 17`, `unshaped`, `deterministic`, …"""
    candidate: int | None
    """Its index in the campaign; None for a reference design."""
    waveform: Waveform
    """What was applied."""
    response: Judged
    """V, closed and status of every fresh switch."""
    assessment: Assessment
    """Eqs. 7-11 on them."""
    training: Training | None
    """What the campaign believed; None for a reference design."""

    @property
    def flattery_cm_s(self) -> float:
        """Certified g minus training g [cm/s]: how much the training ensemble flattered it. NaN for a reference."""
        return math.nan if self.training is None else self.assessment.g_cm_s - self.training.g_cm_s


@dataclass(frozen=True, slots=True, kw_only=True)
class Certification:
    """The certified designs of one campaign."""

    n_switches: int
    """Fresh switches."""
    seed: int
    """Seed of their stream."""
    committed: int
    """Candidates that the campaign had committed."""
    incumbent: int
    """Candidate that the campaign itself calls best."""
    candidates: tuple[Certified, ...]
    """Certified candidates, best first."""
    references: tuple[Certified, ...]
    """Reference designs on the same switches."""

    @property
    def best(self) -> Certified:
        """The best certified candidate."""
        return self.candidates[0]

    def comparison(self, reference: Certified) -> Comparison:
        """The best candidate against another design, switch by switch."""
        best = self.best
        return compare(
            (best.response, best.assessment), (reference.response, reference.assessment), best.assessment.confidence
        )


def certify(
    path: str,
    *,
    n_switches: int = 100_000,
    seed: int | None = None,
    top: int = 10,
    threads: int = 1,
    listener: Step | None = None,
) -> Certification:
    """Certify the `top` best distinct candidates of the campaign at path, and store the result in its group.

    seed: of the fresh switches; the campaign's own by default (their stream differs). The same certification of the
    same candidates is read back rather than computed again; any other replaces it. Raises CertifyError.
    """
    if n_switches < 1 or top < 1:
        raise CertifyError(f"{n_switches} switches and {top} candidates: both must be at least 1 (--switches, --top)")
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    seed = config.campaign.seed if seed is None else seed
    incumbent, chosen = _choose(campaign, config, top)
    try:
        stored = read_certification(path)
    except DamageError:
        stored = None  # a pure function of the store: compute it again
    if stored is not None and stored.n_switches == n_switches and stored.seed == seed:
        same = sorted(d.candidate for d in stored.candidates if d.candidate is not None) == sorted(chosen)
        if same and stored.incumbent == incumbent:
            return stored
    waveforms = {f"candidate {i}": Waveform.from_rows(campaign.waveform(i)) for i in chosen}
    waveforms |= reference_designs(config)
    needs.check_fresh(n_switches, len(waveforms), path=path)
    responses = simulate_fresh(
        config, list(waveforms.values()), n_switches=n_switches, seed=seed, threads=threads, listener=listener
    )
    result = _assemble(campaign, config, waveforms, responses, n_switches, seed, incumbent)
    _write(path, result)
    return result


def read_certification(path: str) -> Certification | None:
    """The certification stored in a campaign; None where there is none."""
    try:
        group = read_group(path, GROUP)
    except StoreMissingError:
        return None
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    a, about = group.arrays, group.attributes
    waveforms = {
        str(name): Waveform.from_rows(rows[~np.isnan(rows).all(axis=1)])
        for name, rows in zip(a["name"], a["waveform"], strict=True)
    }
    responses = [
        Judged(max_contact_speed=v, closed=closed, status=status)
        for v, closed, status in zip(a["max_contact_speed"], a["closed"], a["status"], strict=True)
    ]
    result = _assemble(
        campaign, config, waveforms, responses, int(about["n_switches"]), int(about["seed"]), int(about["incumbent"])
    )
    return replace(result, committed=int(about["committed"]))


def fresh_switches(population: Population, n: int, *, seed: int, start: int = 0) -> FloatArray:
    """Switches `start` to `start + n` of the certification ensemble `seed`: (n, 4) D, G, K, M."""
    return population.sample(n, seed=seed, sampling="monte-carlo", start=start, stream=STREAM)


def simulate_fresh(
    config: CampaignConfig,
    waveforms: list[Waveform],
    *,
    n_switches: int,
    seed: int,
    threads: int = 1,
    listener: Step | None = None,
) -> list[Judged]:
    """Metrics of every waveform on the same fresh switches of the campaign's population, a chunk at a time."""
    from softclose.evaluate import respond

    population = config.build_population()
    v = np.empty((len(waveforms), n_switches))
    closed = np.empty(v.shape, dtype=np.bool_)
    status = np.empty(v.shape, dtype=np.int8)
    total, done = v.size, 0
    for start in range(0, n_switches, CHUNK):
        rows = slice(start, min(start + CHUNK, n_switches))
        switches = fresh_switches(population, rows.stop - start, seed=seed, start=start)
        for i, waveform in enumerate(waveforms):
            response = respond(config, switches, waveform, threads=threads)
            v[i, rows], closed[i, rows] = response.max_contact_speed, response.closed
            status[i, rows] = response.status
            done += len(switches)
            if listener is not None:
                listener(done, total)
    return [Judged(max_contact_speed=v[i], closed=closed[i], status=status[i]) for i in range(len(waveforms))]


def assess_fresh(response: Judged, config: CampaignConfig) -> Assessment:
    """The campaign's own objective, on independent random draws."""
    return judge(config, response, fresh=True)


def reference_designs(config: CampaignConfig) -> dict[str, Waveform]:
    """What every optimum must beat: the unshaped step and, where it exists, the deterministic design."""
    from softclose.baselines import BaselineError, deterministic_design, unshaped

    designs = {"unshaped": unshaped()}
    with contextlib.suppress(BaselineError):  # e.g. a limit that cannot hold the mean switch: nothing to compare with
        designs["deterministic"] = deterministic_design(
            config.build_population(),
            max_volts=config.waveform.max_volts,
            plate_area_um2=config.model.plate_area_um2,
            horizon_us=config.model.horizon_us,
        )
    return designs


def _choose(campaign: Campaign, config: CampaignConfig, top: int) -> tuple[int, list[int]]:
    """The incumbent, and the best distinct candidates: the incumbent first, then by g plus its standard error.

    The standard error stands for the size of the ensemble: g of 200 switches is no promise, g of 20,000 is nearly one.
    """
    best = campaign.best()
    if best is None:
        raise CertifyError(f"{campaign.path} has no usable candidate yet: let the campaign run, then certify")
    table = campaign.records()
    promise = np.where(table["failed"], math.inf, table["g_cm_s"] + np.nan_to_num(table["g_se_cm_s"]))
    order = [best.candidate, *(int(i) for i in np.argsort(promise, kind="stable") if np.isfinite(promise[i]))]
    t = np.linspace(0.0, config.model.horizon_us, 1001)
    chosen: list[int] = []
    shapes: list[FloatArray] = []
    for i in order:
        shape = Waveform.from_rows(campaign.waveform(i)).voltage(t)
        if all(np.sqrt(np.mean((shape - other) ** 2)) >= DISTINCT_VOLTS for other in shapes):
            chosen.append(i)
            shapes.append(shape)
        if len(chosen) == top:
            break
    return best.candidate, chosen


def _assemble(
    campaign: Campaign,
    config: CampaignConfig,
    waveforms: Mapping[str, Waveform],
    responses: list[Judged],
    n_switches: int,
    seed: int,
    incumbent: int,
) -> Certification:
    table = campaign.records()
    candidates: list[Certified] = []
    references: list[Certified] = []
    for (name, waveform), response in zip(waveforms.items(), responses, strict=True):
        kind, _, number = name.partition(" ")
        i = int(number) if kind == "candidate" else None
        training = None
        if i is not None:
            training = Training(
                g_cm_s=float(table["g_cm_s"][i]),
                v_u_cm_s=float(table["v_u_cm_s"][i]),
                p_nc=float(table["p_nc"][i]),
                n_switches=int(table["n_switches"][i]),
            )
        certified = Certified(
            name=name,
            candidate=i,
            waveform=waveform,
            response=response,
            assessment=assess_fresh(response, config),
            training=training,
        )
        (references if i is None else candidates).append(certified)
    candidates.sort(key=lambda d: d.assessment.g_cm_s)  # stable: ties stay in the order chosen
    return Certification(
        n_switches=n_switches,
        seed=seed,
        committed=campaign.committed,
        incumbent=incumbent,
        candidates=tuple(candidates),
        references=tuple(references),
    )


def _write(path: str, result: Certification) -> None:
    """Store the per-switch results, from which everything else follows, and the figures beside them for any reader."""
    designs = [*result.candidates, *result.references]
    n_pulses = max(len(d.waveform.pulses) for d in designs)
    rows = np.full((len(designs), n_pulses, 4), math.nan)
    for row, d in zip(rows, designs, strict=True):
        row[: len(d.waveform.pulses)] = d.waveform.rows()

    def per_switch(values: list[NDArray[Any]], unit: str, meaning: str) -> GroupArray:
        return GroupArray(dims=("design", "fresh_switch"), values=np.stack(values), unit=unit, long_name=meaning)

    arrays = {
        "name": GroupArray(dims=("design",), values=np.array([d.name for d in designs]), long_name="design"),
        "candidate": GroupArray(
            dims=("design",),
            values=np.array([-1 if d.candidate is None else d.candidate for d in designs]),
            long_name="index in the campaign; -1: a reference design",
        ),
        "waveform": GroupArray(
            dims=("design", "pulse", "parameter"),
            values=rows,
            unit="µs or V",
            long_name="start, rise, peak, volts; a peak of inf holds, rows of NaN are absent",
        ),
        "max_contact_speed": per_switch(
            [d.response.max_contact_speed for d in designs], "µm/µs", "V of Eq. 7; NaN: never touched"
        ),
        "closed": per_switch([d.response.closed for d in designs], "1", "held in contact at the horizon"),
        "status": per_switch([d.response.status for d in designs], "1", "outcome of the integration; 0: ok"),
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
    assessed = [records.assessment_record(d.assessment) for d in designs]
    for name, first in assessed[0].items():
        if name not in ("failed", "failure"):
            dims = ("design", "limit") if isinstance(first, np.ndarray) else ("design",)
            unit = "cm/s" if name.endswith("_cm_s") else "1"
            arrays[name] = GroupArray(dims=dims, values=np.array([record[name] for record in assessed]), unit=unit)
    write_group(
        path,
        GROUP,
        arrays,
        {
            "n_switches": result.n_switches,
            "seed": result.seed,
            "stream": STREAM,
            "sampling": "monte-carlo",
            "committed": result.committed,
            "incumbent": result.incumbent,
            "limits_cm_s": [e.limit_cm_s for e in result.best.assessment.p_exceed],
            "level": result.best.assessment.level,
            "confidence": result.best.assessment.confidence,
        },
        replace=True,
    )
