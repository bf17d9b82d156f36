"""Owns what proposals of a campaign will need and are slow to load: while workers start, the driver has time for it."""

from __future__ import annotations

import importlib

from softclose.propose.descents import library
from softclose.propose.design import design_point
from softclose.propose.prior import prior_config
from softclose.propose.protocol import Problem
from softclose.settings import CampaignConfig

PROCESS = ("softclose.propose.surrogate", "softclose.propose.led")
"""What imports the Gaussian process."""


def load_ahead(config: CampaignConfig) -> None:
    """Import libraries and load compiled code as the campaign's engines would at their first proposal.

    Nothing that is proposed depends on it. Raises whatever they would.
    """
    finishes = config.finish.budget and config.finish.method == "cmaes"
    if config.has_prior or config.explore.budget or finishes or config.optimiser.engine == "cmaes":
        library()
        cheap = prior_config(config) if config.has_prior else config
        design_point(Problem(cheap), 0, "scout", 0)
    if config.campaign.budget and config.optimiser.engine == "skopt":
        for name in PROCESS if config.has_prior else PROCESS[:1]:
            importlib.import_module(name)
