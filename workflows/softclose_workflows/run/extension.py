"""Owns the extension of a finished campaign by further candidates."""

from __future__ import annotations

from softclose import ALGORITHM
from softclose.config import CampaignConfig
from softclose_store import extend_campaign, open_campaign
from softclose_workflows.run.creation import layout_of
from softclose_workflows.run.runtime import runtime


def extend(path: str, total: int, *, break_lock: bool = False) -> CampaignConfig:
    """Add candidates to the finished campaign at `path` until it has `total`; returns its configuration now.

    A campaign that has `total` candidates already, finished or not, is left as it is: an extension that was interrupted
    is continued by the same words. Raises ConfigError where it has more, StoreError where it is not finished.
    """
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    if total == config.total_budget:
        return config
    extended = config.extended(total)
    # As stored, but for the one entry: a later version may know settings that this store does not name.
    section = {**campaign.config["campaign"], "extensions": list(extended.campaign.extensions)}
    extend_campaign(
        path,
        layout=layout_of(extended),
        config={**campaign.config, "campaign": section},
        algorithm=ALGORITHM,
        note=runtime(),
        break_lock=break_lock,
    )
    return extended
