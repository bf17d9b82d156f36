"""Owns what a result rests on, in sentences: the switches, the device model, and what stands between lot and drive."""

from __future__ import annotations

from softclose.conditions.protocol import Condition
from softclose.evaluate import chain
from softclose.plugins import REDUCED_ORDER, SINGLE_MODE
from softclose.settings import CampaignConfig
from softclose.settings.model import ModelSection


def assumptions(config: CampaignConfig) -> list[str]:
    """One sentence for each thing that a reader of the figures has to believe, the most consequential first."""
    by_switch = [kind for kind in chain.CONDITIONS if kind.tailored]
    others = [kind for kind in chain.CONDITIONS if not kind.tailored]
    return [
        *_of_conditions(by_switch, config),
        _lot(config),
        _model(config.model),
        *_of_conditions(others, config),
        *_opening(config),
    ]


def _of_conditions(kinds: list[type[Condition]], config: CampaignConfig) -> list[str]:
    return [sentence for kind in kinds for sentence in kind.assumed(getattr(config, kind.section))]


def _lot(config: CampaignConfig) -> str:
    what = config.build_population().description
    return (
        f"The lot is the population “{config.population.name}”{f' ({what})' if what else ''}: the figures hold for "
        "devices that are distributed as it says."
    )


def _model(m: ModelSection) -> str:
    if m.name == SINGLE_MODE:
        losses = [
            *([f"a quality factor of {m.quality_factor:g}"] if m.quality_factor else []),
            *([f"a squeezed film of {m.film_viscosity_uPa_s:g} µPa s"] if m.film_viscosity_uPa_s else []),
            *([f"an adhesion of {m.adhesion_uN:g} µN"] if m.adhesion_uN else []),
        ]
        kind = f"a plate with one mode of vibration and {' and '.join(losses) if losses else 'no damping'}"
    elif m.name == REDUCED_ORDER:
        kind = f"the reduced-order model {m.modes or 'written in the store'}"
    else:
        kind = f"the device model {m.name}"
    return f"Each switch is {kind}; it rebounds with {m.restitution:g} of its speed at each impact."


def _opening(config: CampaignConfig) -> list[str]:
    if not config.opening.release_us:
        return []
    return [f"The switches are released at {config.opening.release_us:g} µs; until then the voltage holds them."]
