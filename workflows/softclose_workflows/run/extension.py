"""Owns the extension of a finished campaign: further candidates, or those again that failed."""

from __future__ import annotations

import numpy as np

from softclose import ALGORITHM
from softclose.settings import CampaignConfig
from softclose_store import StoreError, extend_campaign, open_campaign
from softclose_workflows.run.creation import layout_of
from softclose_workflows.run.runtime import runtime


def extend(path: str, total: int, *, break_lock: bool = False) -> CampaignConfig:
    """Add candidates to the finished campaign at `path` until it has `total`; returns its configuration now.

    A campaign that has `total` candidates already, finished or not, is left as it is: an extension that was interrupted
    is continued by the same words. Raises ConfigError where it has more, StoreError where it is not finished.
    """
    config = CampaignConfig.from_dict(open_campaign(path).config)
    if total == config.total_budget:
        return config
    return _extend(path, config.extended(total), break_lock)


def retry_failed(path: str, *, break_lock: bool = False) -> CampaignConfig:
    """Add the failed candidates of the finished campaign at `path`, to be computed again; returns its configuration.

    Their records stay: what was proposed after them saw them fail. One that fails again may be tried again; a retry
    that was interrupted is continued by the same words. Raises StoreError where none failed, or it is not finished.
    """
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    extensions = config.campaign.extensions
    if not campaign.finished and extensions and isinstance(extensions[-1], tuple):
        return config
    retried = {i for what in extensions if isinstance(what, tuple) for i in what}
    failed = [int(i) for i in np.flatnonzero(campaign.records()["failed"]) if i not in retried]
    if not failed:
        raise StoreError(f"none of the {campaign.committed} candidates in {path} failed: there is nothing to retry")
    return _extend(path, config.retried(failed), break_lock)


def _extend(path: str, extended: CampaignConfig, break_lock: bool) -> CampaignConfig:
    # As stored, but for the one entry: a later version may know settings that this store does not name.
    stored = open_campaign(path).config
    section = {**stored["campaign"], "extensions": extended.to_dict()["campaign"]["extensions"]}
    extend_campaign(
        path,
        layout=layout_of(extended),
        config={**stored, "campaign": section},
        algorithm=ALGORITHM,
        note=runtime(),
        break_lock=break_lock,
    )
    return extended
