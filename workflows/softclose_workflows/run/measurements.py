"""Owns where the blocks of a measured campaign wait, and the commit of those that were told before a kill."""

from __future__ import annotations

from collections import deque

from softclose import ALGORITHM
from softclose.plugins import MEASURED
from softclose.settings import CampaignConfig
from softclose_store import DriverStore, open_campaign
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.executors.protocol import Contact, Event, Task
from softclose_workflows.run.tasks import BlockTask


class AwaitedBlocks:
    """Stands where an executor does: blocks wait here until somebody has measured them."""

    n_workers = 0
    n_retries = 0
    dashboard: str | None = None
    contact: Contact | None = None

    def __init__(self) -> None:
        self.waiting: deque[BlockTask] = deque()
        self.told: deque[Event] = deque()

    @property
    def has_finished(self) -> bool:
        return bool(self.told)

    def probe(self, store: str, fingerprint: str) -> None:
        """Devices are not asked whether they can."""

    def submit(self, task: Task) -> None:
        assert isinstance(task, BlockTask)
        self.waiting.append(task)

    def next_event(self, timeout_s: float) -> Event | None:
        return self.told.popleft() if self.told else None


def settle(driver: Driver) -> None:
    """Commit every wave whose measurements are all stored, and put forward what has to be measured next.

    A kill, an interrupt or a full disk may have come between the last measurement of a wave and its commit.
    """
    driver.launch()
    while driver.is_ready:
        driver.advance()
        driver.launch()


def commit_told(path: str, *, break_lock: bool = False) -> int:
    """Commit what was told and, for a kill or a full disk, not committed. Returns how many candidates that made.

    0 for a campaign that is simulated: `resume` goes on with it. Raises LockedError, Stopped.
    """
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    if config.model.name != MEASURED or campaign.committed == config.total_budget:
        return 0
    with DriverStore(path, expected_algorithm=ALGORITHM, break_lock=break_lock) as store:
        before = store.n_committed
        settle(Driver(store, AwaitedBlocks()))
        return store.n_committed - before
