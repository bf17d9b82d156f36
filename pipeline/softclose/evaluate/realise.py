"""Owns `realise`, the only maker of lots: uniform coordinates in, a table of switches out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from softclose.arrays import FloatArray
from softclose.conditions.learning import Actuation, TailoredByLearning
from softclose.conditions.protocol import Coordinate, Uniforms
from softclose.conditions.streams import Ensemble, Stream
from softclose.device.told import switches_of
from softclose.evaluate.chain import chain_of
from softclose.population import Population, Sampling
from softclose.population.lot import DEVICE_COLUMNS, Lot
from softclose.population.population import index_uniforms
from softclose.settings import CampaignConfig

OWN = "lot"
"""Name of the coordinates of a switch itself."""


def coordinates(config: CampaignConfig) -> tuple[Coordinate, ...]:
    """What is drawn of each switch: its own four variables first, then what each condition asks for."""
    chain = chain_of(config)
    own = Coordinate(name=OWN, stream=Stream.LOT, parts=chain.around.population.variables)
    return (own, *(c for condition in chain.conditions for c in condition.coordinates))


def uniforms(
    config: CampaignConfig,
    n: int,
    *,
    seed: int,
    sampling: Sampling = "monte-carlo",
    start: int = 0,
    ensemble: int = Ensemble.TRAINING,
) -> Uniforms:
    """Coordinates of switches `start` to `start + n` of an ensemble.

    Row i depends on (seed, ensemble, start + i) and nothing else. `sampling` is that of the switches' own variables;
    what conditions draw is independent random whatever it is.
    """
    own, *others = coordinates(config)
    population = chain_of(config).around.population
    return {own.name: population.uniforms(n, seed=seed, sampling=sampling, start=start, stream=int(ensemble))} | {
        c.name: index_uniforms(n, seed=seed, start=start, stream=int(ensemble) + int(c.stream))[:, : len(c.parts)]
        for c in others
    }


def realise(
    config: CampaignConfig,
    u: Uniforms,
    *,
    design: Mapping[str, float] | None = None,
    population: Population | None = None,
) -> Lot:
    """The lot at given coordinates, with everything that the campaign's conditions add to it.

    Parameters
    ----------
    config : CampaignConfig
        Population and conditions.
    u : mapping
        `coordinates` by name, (n, size) each.
    design : mapping, optional
        Nominal values other than the population's own: variable -> mean, all of it scaled (Eq. 14). The campaign's
        conditions are then those of that lot.
    population : Population, optional
        Where the switches come from instead, while the conditions go on believing in the campaign's own.

    Returns
    -------
    Lot
        D, G, the two variables that K and M follow from, K, M, and what conditions add.

    Raises
    ------
    PopulationError
        For a design that is none.
    """
    if design:
        changed = config.build_population().with_means(design)
        config = replace(config, population_model=changed.to_dict())
    return _changed(config, _drawn(config, u, population), u)


def _changed(config: CampaignConfig, lot: Lot, u: Uniforms, contacts: Sequence[FloatArray] = ()) -> Lot:
    """A lot with everything that the conditions add to it. contacts: of the actuations, where they have been made."""
    for condition in chain_of(config).conditions:
        if contacts and isinstance(condition, TailoredByLearning):
            lot = condition.lot_after(lot, u, contacts)
        else:
            lot = condition.lot(lot, u)
    return lot


def column_names(config: CampaignConfig) -> tuple[str, ...]:
    """The columns of a lot that `realise` makes, in their order."""
    chain = chain_of(config)
    added = (name for condition in chain.conditions for name in condition.columns)
    return tuple(dict.fromkeys((*chain.around.population.variables, *DEVICE_COLUMNS, *added)))


def actuations(
    config: CampaignConfig, n: int, *, seed: int, sampling: Sampling = "monte-carlo", start: int = 0, **outputs: Any
) -> list[Actuation]:
    """The actuations by which a trim learns what switches `start` to `start + n` of the training ensemble are like.

    seed, sampling, start: those of `draw`; outputs: of the device model, such as `times_us`. [] where nothing is
    actuated.
    """
    u = uniforms(config, n, seed=seed, sampling=sampling, start=start)
    lot = _drawn(config, u, None)
    for condition in chain_of(config).conditions:
        if isinstance(condition, TailoredByLearning):
            return condition.actuations(lot, **outputs)
        lot = condition.lot(lot, u)
    return []


def n_actuations(config: CampaignConfig) -> int:
    """Motions of each switch among its actuations; 0 where nothing is actuated."""
    learns = [c for c in chain_of(config).conditions if isinstance(c, TailoredByLearning)]
    return learns[0].n_motions if learns else 0


def _drawn(config: CampaignConfig, u: Uniforms, population: Population | None) -> Lot:
    """The lot before any condition."""
    chain = chain_of(config)
    drawn = chain.around.population if population is None else population
    parameters = drawn.quantile(u[OWN])
    switches = switches_of(drawn, chain.device, parameters)
    columns: dict[str, FloatArray] = dict(zip(drawn.variables, parameters.T, strict=True))
    columns |= dict(zip(DEVICE_COLUMNS, switches.T, strict=True))
    return Lot(columns, plate_area_um2=drawn.plate_area_um2)


def draw(
    config: CampaignConfig,
    n: int,
    *,
    seed: int,
    sampling: Sampling = "monte-carlo",
    start: int = 0,
    ensemble: int = Ensemble.TRAINING,
) -> Lot:
    """Draw switches of the campaign's lot, with everything that its conditions add to them.

    Row i depends on (seed, ensemble, start + i) and nothing else: ensembles can be drawn in pieces.

    Parameters
    ----------
    config : CampaignConfig
        Population and conditions.
    n : int
        Number of switches.
    seed : int
        Which ensemble.
    sampling : {"monte-carlo", "sobol"}
        How the switches' own variables fill the unit cube; what conditions draw is independent random.
    start : int
        Index of the first switch.
    ensemble : int
        Who draws: `softclose.conditions.streams.Ensemble`.

    Returns
    -------
    Lot
    """
    return realise(config, uniforms(config, n, seed=seed, sampling=sampling, start=start, ensemble=ensemble))


def draw_after(
    config: CampaignConfig, n: int, contacts: Sequence[FloatArray], *, seed: int, sampling: Sampling = "monte-carlo"
) -> Lot:
    """As `draw` of the training ensemble, whose `actuations` have been made. contacts: (n,) first contacts of each."""
    u = uniforms(config, n, seed=seed, sampling=sampling)
    return _changed(config, _drawn(config, u, None), u, contacts)
