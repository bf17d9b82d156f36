"""Owns the Dask executor: tasks on a cluster, local or one's own."""

from __future__ import annotations

import contextlib
import ipaddress
import logging
import os
import queue
import socket
import threading
import time
import uuid
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from softclose import ALGORITHM
from softclose_workflows.errors import ExecutorError, Stopped
from softclose_workflows.run.executors.protocol import Contact, Event, Task, run_task
from softclose_workflows.run.faults import MAX_TRIES
from softclose_workflows.run.forking import ALLOCATOR, METHOD, start_ahead

if TYPE_CHECKING:
    from distributed import Client, Future

    Answer = Future[Any]

LIVE_PER_WORKER = 4
"""Blocks sent ahead for each worker, so that none waits for the driver."""

MOST_LIVE = 1000
"""Blocks under way at once, at most: a scheduler keeps about 16 KiB for each."""

REFILL_S = 0.5
"""Least time between two attempts to start workers in place of lost ones [s]."""

SILENT = logging.CRITICAL + 1
"""A level above every message."""


@dataclass(frozen=True, slots=True)
class UnderWay:
    """A block under way."""

    task: Task
    future: Answer
    workers: frozenset[str] | None
    """Where alone it may run; None: anywhere."""


class DaskExecutor:
    """Runs blocks on a Dask cluster through one client."""

    def __init__(
        self,
        client: Client,
        dashboard: str | None,
        patience_s: float,
        refill: Callable[[int], Any] | None = None,
        wanted: int | None = None,
    ) -> None:
        """`refill` starts workers until there are so many: a local cluster's own restarts give up on some deaths.

        wanted: how many; by default as many as there are now.
        """
        self._client = client
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._futures: dict[str, UnderWay] = {}
        self._waiting: deque[Task] = deque()
        self._feeding = threading.Lock()
        # A token per run: a long-lived cluster must not hand back the results of an earlier run's equal keys.
        self._token = uuid.uuid4().hex[:8]
        self._last_alive = time.monotonic()
        self._patience_s = patience_s
        self.dashboard = dashboard
        self.contact: Contact | None = None
        self.n_retries = 0
        self._workers = set(client.scheduler_info(n_workers=-1)["workers"])
        self._wanted = len(self._workers) if wanted is None else wanted
        self._refill = refill
        self._refilled = time.monotonic()
        self._campaign: tuple[str, str] | None = None
        self._unfit: dict[str, str] = {}
        """Workers that cannot compute blocks of the campaign, and why."""
        # The scheduler tells who comes and goes: looking now and then would miss a worker that dies at once.
        client.subscribe_topic("all", self._membership)

    def close(self) -> None:
        """Stop listening to the scheduler, so that neither side writes to the other while they part."""
        with contextlib.suppress(Exception):  # the scheduler may be gone
            self._client.unsubscribe_topic("all")

    def probe(self, store: str, fingerprint: str) -> None:
        """See `Executor.probe`."""
        self._campaign = store, fingerprint
        self._ask(store, fingerprint)
        self._check_fit()

    def _ask(self, store: str, fingerprint: str, workers: list[str] | None = None) -> None:
        """Have workers, by default all, look at the campaign's store; remember those that cannot use it."""
        from softclose_workflows.run.workers import probe

        answers = self._client.run(probe, store, fingerprint, ALGORITHM, workers=workers, on_error="return")
        for address, answer in answers.items():
            if isinstance(answer, BaseException):  # it could not even be asked: a package is missing
                answer = f"{type(answer).__name__}: {answer}"
            if answer:
                self._unfit[address] = answer

    def _ask_newcomer(self, store: str, fingerprint: str, worker: str) -> None:
        """Beside Dask's event loop. One that is gone before it answers is no loss."""
        with contextlib.suppress(Exception):
            self._ask(store, fingerprint, [worker])

    def _fit(self) -> list[str]:
        return sorted(self._workers - self._unfit.keys())

    def _check_fit(self) -> None:
        if self._unfit and self._workers and not self._fit():
            reasons = Counter(self._unfit.values()).most_common()
            told = "; ".join(f"{reason} ({n} of {len(self._unfit)})" for reason, n in reasons[:MAX_TRIES])
            raise Stopped(f"no worker can compute blocks of this campaign: {told}")

    @property
    def n_workers(self) -> int:
        """Workers connected now."""
        return len(self._workers)

    def _membership(self, event: tuple[float, Any]) -> None:
        """Runs in Dask's event loop, for every event that the scheduler tells to all."""
        message = event[1] if isinstance(event[1], dict) else {}
        if message.get("action") == "add-worker":
            self._workers.add(message["worker"])
            self._last_alive = time.monotonic()
            if self._campaign is not None:
                asked = (*self._campaign, message["worker"])
                threading.Thread(target=self._ask_newcomer, args=asked, daemon=True).start()
        elif message.get("action") == "remove-worker":
            self._workers.discard(message["worker"])
            self._unfit.pop(message["worker"], None)
            self._last_alive = time.monotonic()
            self.n_retries += not message.get("expected", False)

    @property
    def has_finished(self) -> bool:
        """True where a result waits to be asked for."""
        return not self._events.empty()

    def submit(self, task: Task) -> None:
        """Send one task, or keep it until fewer are under way; its outcome arrives through `next_event`."""
        self._waiting.append(task)
        self._feed()

    def _feed(self) -> None:
        """Send what there is room for: a scheduler remembers every task that it holds."""
        with self._feeding:
            room = min(max(LIVE_PER_WORKER * len(self._workers), LIVE_PER_WORKER), MOST_LIVE) - len(self._futures)
            for _ in range(min(room, len(self._waiting))):
                self._send(self._waiting.popleft())

    def _send(self, task: Task) -> None:
        key = f"{task.key}-{self._token}-{uuid.uuid4().hex[:6]}"
        chosen = self._fit() if self._unfit else None
        future = self._client.submit(run_task, task, key=key, pure=False, workers=chosen)
        self._futures[key] = UnderWay(task, future, None if chosen is None else frozenset(chosen))
        future.add_done_callback(lambda done: self._finished(task, done))

    def _finished(self, task: Task, future: Answer) -> None:
        """Runs on Dask's callback thread."""
        if str(future.key) not in self._futures:
            return
        try:
            outcome: Any = self._outcome(task, future)
        except BaseException as e:  # the thread is Dask's: what is raised here would be seen by nobody
            outcome = e
        # Dask would compute a result again whose only holder died, for as long as someone holds its future.
        self._futures.pop(str(future.key), None)
        self._events.put((task, outcome))
        self._feed()

    def _send_again(self) -> None:
        """Blocks that were meant for workers which are all gone would wait for ever: others get them."""
        with self._feeding:
            for key, sent in list(self._futures.items()):
                if sent.workers is not None and not sent.workers & self._workers and self._fit():
                    del self._futures[key]
                    sent.future.cancel()
                    self._send(sent.task)

    def _outcome(self, task: Task, future: Answer) -> Any:
        from distributed.scheduler import KilledWorker

        if future.status == "finished":
            return future.result(timeout=self._patience_s)
        failure: BaseException | None = future.exception() if future.status == "error" else None
        if isinstance(failure, KilledWorker):
            return Stopped(
                f"{task.name} killed {MAX_TRIES + 1} workers in a row: too little memory for a block "
                "(compute.block_switches), or a fault of the device model"
            )
        if failure is not None:
            return failure
        return Stopped(f"{task.name} was cancelled: the scheduler is gone, or dropped this client")

    def next_event(self, timeout_s: float) -> Event | None:
        """See `Executor.next_event`."""
        self._keep_up()
        try:
            event = self._events.get(timeout=timeout_s)
        except queue.Empty:
            self._check_fit()
            self._send_again()
            connected = self._client.status == "running"
            if connected and self._workers:
                self._last_alive = time.monotonic()
            elif time.monotonic() - self._last_alive > self._patience_s:
                what = "no worker is left" if connected else "the scheduler is gone"
                raise Stopped(f"{what} (waited {self._patience_s:g} s)") from None
            return None
        self._last_alive = time.monotonic()
        return event

    def _keep_up(self) -> None:
        """Start workers in place of those that are gone, also while the rest are busy."""
        if self._refill is None or time.monotonic() - self._refilled < REFILL_S:
            return
        self._refilled = time.monotonic()
        if len(self._workers) < self._wanted:
            self._refill(self._wanted)


WATCHING: dict[str, object] = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.admin.system-monitor.disk": False,
    "distributed.admin.system-monitor.gil.enabled": False,
    "distributed.worker.memory.monitor-interval": "500ms",
}
"""How closely Dask watches itself: each process of a cluster looks at its stacks, its event loop and its memory up to a
hundred times a second, for a dashboard, and takes a tenth of a core for it whether there is work or not."""


def configure() -> None:
    """Dask's settings for every cluster of ours, and all of it imported."""
    import dask
    import distributed.utils

    if (
        METHOD == "forkserver"
    ):  # what is loaded ahead is ours to say: Dask would import here whatever it finds installed
        distributed.utils._forkserver_preload_set = True
    dask.config.set(
        {
            "distributed.scheduler.allowed-failures": MAX_TRIES,
            **WATCHING,
            "distributed.worker.multiprocessing-method": METHOD,
            **{f"distributed.nanny.pre-spawn-environ.{name}": size for name, size in ALLOCATOR.items()},
            # Blocks are long and few: stealing and work queueing buy nothing, a quick restart does.
            "distributed.comm.timeouts.connect": "10s",
            "distributed.deploy.lost-worker-timeout": "3s",
            "distributed.admin.log-format": "%(levelname)s %(message)s",
        }
    )
    # A worker's death is reported by us, once; Dask's own account of it runs to a page.
    for name in (
        "distributed.nanny",
        "distributed.scheduler",
        "distributed.worker",
        "distributed.core",
        "distributed.comm",
        "distributed.client",
        "tornado.application",
        "asyncio",
    ):
        logging.getLogger(name).setLevel(SILENT)


@contextlib.contextmanager
def local_cluster(workers: int, patience_s: float) -> Iterator[DaskExecutor]:
    """A cluster of this machine's processes, for the length of a `with` block."""
    start_ahead()
    configure()
    from distributed import Client, LocalCluster

    # Everything listens on loopback, and speaks TLS with certificates made for this run alone: whoever reaches a
    # scheduler runs code as its user, and other users of this machine reach its loopback
    # (docs/explanation/security.md).
    try:
        cluster = LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            protocol="tls://",
            security=True,
            dashboard_address="127.0.0.1:0",
            worker_dashboard_address=None,
            silence_logs=SILENT,
            env=dict(os.environ),  # as it is now, not as it was when the process began that they are forked from
        )
    except (RuntimeError, OSError, TimeoutError) as e:
        reason: BaseException = e
        while cause := reason.__cause__ or reason.__context__:
            reason = cause
        raise ExecutorError(
            f"no cluster of {workers} workers starts on this machine ({type(reason).__name__}: {reason}); look at its "
            "limits (ulimit -n, -u, -v; /dev/shm), give fewer --workers, or compute in this process with --serial; in "
            'a script, is the call under `if __name__ == "__main__":`?'
        ) from e
    with cluster, Client(cluster, set_as_default=False) as client:
        yield from on_client(client, cluster.dashboard_link, patience_s, cluster.scale)


@contextlib.contextmanager
def remote_cluster(address: str, patience_s: float, *, plain_tcp: bool = False) -> Iterator[DaskExecutor]:
    """The cluster behind a scheduler's address. Raises ExecutorError where none answers.

    plain_tcp: also where the address is another host's and speaks no TLS.
    """
    configure()
    from distributed import Client, Security

    if address.startswith("tls://") and Security().get_connection_args("client").get("ssl_context") is None:
        raise ExecutorError(
            f"{address} speaks TLS, and no certificate is configured here: `softclose tls FOLDER` makes one "
            "and says how to use it (docs/explanation/security.md)"
        )
    if not plain_tcp and not address.startswith(("tls://", "wss://", "inproc://")) and not _is_loopback(address):
        raise ExecutorError(
            f"{address} is another host's and plain TCP, by which everybody on the way can run code as you: use TLS "
            "(`softclose tls FOLDER`), or say --plain-tcp where nobody else reaches that network"
        )
    try:
        client = Client(address, timeout=10, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as e:
        raise ExecutorError(
            f"no Dask scheduler answers at {address}: start one (dask scheduler) or leave --scheduler out ({e})"
        ) from e
    with client:
        yield from on_client(client, client.dashboard_link, patience_s)


def _is_loopback(address: str) -> bool:
    """Whether an address, with or without `tcp://`, is of this machine's loopback; True where it is no address."""
    host = urlsplit(address if "://" in address else f"tcp://{address}").hostname
    if not host:
        return True
    try:
        found = {entry[4][0] for entry in socket.getaddrinfo(host, None)}
    except OSError:
        return False
    return all(ipaddress.ip_address(str(ip).partition("%")[0]).is_loopback for ip in found)


def _contact(client: Client) -> Contact:
    """Of a connected client. Dask takes certificates and keys themselves where paths of files are expected."""
    given = client.security.get_tls_config_for_role("client")
    names = {"ca_file": "CA_FILE", "cert": "CLIENT__CERT", "key": "CLIENT__KEY"}
    tls = {f"DASK_DISTRIBUTED__COMM__TLS__{to}": str(given[name]) for name, to in names.items() if given.get(name)}
    return Contact(address=str(client.scheduler_info(n_workers=0)["address"]), environment=tls)


def on_client(
    client: Client,
    dashboard: str | None,
    patience_s: float,
    refill: Callable[[int], Any] | None = None,
    wanted: int | None = None,
) -> Iterator[DaskExecutor]:
    """An executor on a connected client; the arguments are the executor's."""
    from softclose_workflows.run.workers import WorkerSetup

    with contextlib.suppress(Exception):  # a worker without our packages cannot load it; the probe names that one
        client.register_plugin(WorkerSetup(), name="softclose")
    executor = DaskExecutor(client, dashboard, patience_s, refill, wanted)
    executor.contact = _contact(client)
    try:
        yield executor
    finally:
        executor.close()
