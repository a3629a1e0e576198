"""Workers of a Dask cluster: one of this machine, or whatever listens at the address of a scheduler."""

from __future__ import annotations

import hashlib
import pickle
import queue
import sys
import threading
import time
import uuid
from collections.abc import Generator, Iterable
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from dynident.errors import BadOption, MissingDependency, PoolFailed
from dynident.workers.processes import Done, Pool, Tell, Work, check_time_limit, uninterrupted_start

#: Packages whose versions decide about the bits of a result, or about whether pickles are understood.
PACKAGES = ("dynident", "numpy", "scipy", "numba", "llvmlite", "dask", "distributed", "cloudpickle")

#: Time in s that is waited for a scheduler to answer, and for the first worker.
PATIENCE_S, WORKERS_S = 10.0, 60.0

#: Time in s without any worker after which a run is given up.
LOST_S = 300.0

#: Setting of Dask: after which time a local cluster gives up a worker that is started anew; 15 s are few under load.
_LOST = "distributed.deploy.lost-worker-timeout"

#: Time in s between two looks at the clocks of tasks.
_LOOK = 0.2

#: Time in s between two counts of the workers.
_COUNT = 1.0

_NO_TASK: Any = object()

_BEGUN, _NEWS, _ENDED = "begun", "news", "ended"


@dataclass(frozen=True)
class DaskPool(Pool):
    """Workers of a Dask cluster; a task whose worker is lost is done anew by another.

    A worker does one task at a time, on one thread, whatever its number of threads. Before its first task it must prove
    that it runs the same code: versions of the packages that matter, and the hash of this package's files.

    Attributes:
        scheduler: ``local`` or ``local:N`` for N processes of this machine, the address of a scheduler such as
            ``tcp://host:8786``, or its JSON file.
        workers: Number of processes of ``local``; 0 for one a processor.
    """

    scheduler: str
    workers: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        kind, _, count = self.scheduler.partition(":")
        if kind == "local":
            if count and not (count.isdecimal() and int(count) > 0):
                raise BadOption("--scheduler", self.scheduler, "write local:N with 1 or more processes")
            object.__setattr__(self, "workers", int(count or 0))
        elif "://" not in self.scheduler and not Path(self.scheduler).is_file():
            step = "give local, local:N, an address such as tcp://host:8786, or the scheduler's JSON file"
            raise BadOption("--scheduler", self.scheduler, step)

    @property
    def is_local(self) -> bool:  # type: ignore[override]
        """Whether workers see the files of this machine under the same names."""
        return self.scheduler.partition(":")[0] == "local"

    def run(
        self,
        work: Work,
        tasks: Iterable[Any],
        *,
        time_limit: float | None = None,
        begins: Tell = lambda task: None,
        news: Tell = lambda said: None,
    ) -> Generator[Done, None, None]:
        """Yield tasks as they end; see :meth:`Pool.run`.

        A task that is over its time is taken from its worker, which its nanny starts anew.

        Raises:
            BadOption: No scheduler answers.
            MissingDependency: Dask is not installed.
        """
        check_time_limit(time_limit)
        cluster, client = _connected(self)
        import dask.config

        try:
            _check_versions(client, self.scheduler)
            session = _Session(client, work, begins, news)
            with dask.config.set({_LOST: LOST_S}):
                yield from session.run(iter(tasks), time_limit)
        finally:
            client.close()
            if cluster is not None:
                cluster.close()


def _connected(pool: DaskPool) -> tuple[Any, Any]:
    """Return the cluster of this machine, None for one elsewhere, and the client, with a worker at least."""
    try:
        import distributed
    except ImportError as error:
        raise MissingDependency(f"--scheduler {pool.scheduler}", "distributed", "dask") from error
    if pool.is_local:
        settings: Any = {"n_workers": pool.workers or None, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
        with uninterrupted_start():
            cluster = distributed.LocalCluster(processes=True, **settings)
        return cluster, distributed.Client(cluster)
    where: Any = {"scheduler_file": pool.scheduler} if "://" not in pool.scheduler else {"address": pool.scheduler}
    try:
        client = distributed.Client(**where, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        evidence = " ".join(str(error).split())
        step = f"no Dask scheduler answers there ({evidence}); start one with 'dask scheduler', or give local"
        raise BadOption("--scheduler", pool.scheduler, step) from error
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except TimeoutError as error:
        client.close()
        step = f"start one: dask worker {pool.scheduler} --nthreads 1"
        raise PoolFailed(f"the scheduler at {pool.scheduler}", f"no worker in {WORKERS_S:g} s", step) from error
    return None, client


def _check_versions(client: Any, scheduler: str) -> None:
    """Refuse workers with other versions before anything is sent that they might not understand.

    Raises:
        PoolFailed: Naming the packages and the workers.
    """
    wanted = package_versions()
    told = client.get_versions(packages=list(PACKAGES))["workers"]
    wrong: dict[str, list[str]] = {}
    for address, facts in sorted(told.items()):
        packages = facts["packages"]
        own = {name: packages.get(name) for name in PACKAGES} | {"python": _python(str(packages.get("python")))}
        for name, here in wanted.items():
            if own[name] != here:
                wrong.setdefault(f"{name} {own[name] or 'is not installed'}, here {here or 'none'}", []).append(address)
    if wrong:
        evidence = "; ".join(f"{what} (on {_some(workers)})" for what, workers in wrong.items())
        step = "install the same versions on all of them, and start them anew (docs/scale.md)"
        raise PoolFailed(f"the cluster at {scheduler}", f"other versions than here: {evidence}", step)


def _some(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _python(text: str) -> str:
    return ".".join(text.split(".")[:2])


def package_versions() -> dict[str, str | None]:
    """Return the versions of the packages that cluster and client must share; None where one is missing."""
    found: dict[str, str | None] = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    return found | {"python": "{}.{}".format(*sys.version_info)}


@cache
def installation() -> str:
    """Return the hash of the files of this package and of the versions that matter: two that agree compute the same."""
    root, found = Path(__file__).resolve().parents[1], hashlib.sha256(repr(package_versions()).encode())
    for file in sorted(root.rglob("*.py")):
        found.update(str(file.relative_to(root)).encode() + b"\0" + file.read_bytes())
    return found.hexdigest()


class _Session:
    """One run: what is at the workers, and what they say."""

    def __init__(self, client: Any, work: Work, begins: Tell, news: Tell) -> None:
        self._client, self._begins, self._news = client, begins, news
        self._heard: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()
        self._topic = f"dynident-{uuid.uuid4().hex}"
        # As a task, not as data that is sent along: so the cluster can make it again where all its holders are lost.
        self._holder = client.submit(pickle.loads, pickle.dumps(work), key=f"{self._topic}-work", pure=False)
        self._tasks: dict[str, Any] = {}
        self._futures: dict[str, Any] = {}
        self._begun: dict[str, tuple[float, str]] = {}
        client.subscribe_topic(self._topic, lambda event: self._heard.put(pickle.loads(event[1])))

    def run(self, tasks: Any, time_limit: float | None) -> Generator[Done, None, None]:
        """Yield tasks as they end."""
        number, places, counted, seen = 0, 1, 0.0, time.monotonic()
        while True:
            if time.monotonic() - counted > _COUNT:  # workers come and go
                places, counted = len(self._client.nthreads()), time.monotonic()
                seen = counted if places else seen
                if counted - seen > LOST_S:
                    step = "start workers anew, and give the same command: what is done is kept"
                    raise PoolFailed("the cluster", f"all its workers are gone, for {LOST_S:g} s", step)
            room = max(places, 1) - len(self._futures)
            while room > 0 and (task := next(tasks, _NO_TASK)) is not _NO_TASK:
                number += 1
                self._send(f"{self._topic}-{number}", task)
                room -= 1
            if not self._futures:
                return
            yield from self._ended()
            if time_limit is not None:
                yield from self._late(time_limit)

    def _send(self, key: str, task: Any) -> None:
        sent = self._holder, pickle.dumps(task), self._topic, key, installation()
        future = self._client.submit(_performed, *sent, key=key, pure=False)
        self._tasks[key], self._futures[key] = task, future
        future.add_done_callback(lambda ended: self._heard.put((_ENDED, key)))

    def _ended(self) -> Generator[Done, None, None]:
        """Pass on what has been said; yield the tasks that have ended."""
        try:
            kind, said = self._heard.get(timeout=_LOOK)
        except queue.Empty:
            if self._client.status != "running":
                step = "look at its log, start it again and give the same command: what is done is kept"
                raise PoolFailed("the cluster", "its scheduler is gone", step) from None
            return
        if kind == _NEWS:
            self._news(said)
        elif kind == _BEGUN:
            key, worker = said
            if key in self._futures:
                self._begun[key] = time.monotonic(), worker
                self._begins(self._tasks[key])
        elif said in self._futures:
            yield self._done(said)

    def _done(self, key: str) -> Done:
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError

        future, task = self._futures.pop(key), self._tasks.pop(key)
        begun, worker = self._begun.pop(key, (time.monotonic(), ""))
        seconds = time.monotonic() - begun
        try:
            result = pickle.loads(future.result())
        except KilledWorker as error:
            lost = error.allowed_failures + 1
            return Done(task, seconds, failure=f"{lost} workers died of it: out of memory?")
        except (FutureCancelledError, OSError) as error:
            step = "look at its log, start it again and give the same command: what is done is kept"
            raise PoolFailed("the cluster", f"the task is lost ({' '.join(str(error).split())})", step) from error
        except ModuleNotFoundError as error:
            step = f"install the same versions there as here ({error})"
            raise PoolFailed("the cluster", f"the worker {worker} lacks a package", step) from error
        finally:
            future.release()
        return Done(task, seconds, result)

    def _late(self, time_limit: float) -> Generator[Done, None, None]:
        """Take tasks that are over their time from their workers."""
        for key, (begun, worker) in list(self._begun.items()):
            seconds = time.monotonic() - begun
            if seconds < time_limit or key not in self._futures:
                continue
            future, task = self._futures.pop(key), self._tasks.pop(key)
            del self._begun[key]
            future.cancel(force=True)
            try:
                self._client.restart_workers([worker], timeout=WORKERS_S, raise_for_error=False)
            except ValueError as error:
                step = "start workers without --no-nanny, or leave the time limit out"
                raise PoolFailed("the cluster", f"{worker} has no nanny that could end a late task", step) from error
            yield Done(task, seconds, failure=f"ended at the time limit of {time_limit:g} s", late=True)


#: One task of ours at a time in a worker, however many threads it has: the libraries count threads by the process.
_one_at_a_time = threading.Lock()


class Withdrawn(Exception):
    """The task is no longer wanted."""


def _performed(work: Work, content: bytes, topic: str, key: str, wanted: str) -> bytes:
    """Do a task in a worker; its result is pickled here, so that the scheduler never has to understand it."""
    from distributed import get_worker

    worker = get_worker()

    def say(kind: str, said: Any) -> None:
        worker.log_event(topic, pickle.dumps((kind, said)))

    def tell(said: Any) -> None:
        known = worker.state.tasks.get(key)  # the client's Ctrl-C reaches a task that runs as this state
        if known is None or known.state == "cancelled":
            raise Withdrawn(key)
        say(_NEWS, said)

    _check_code(wanted, worker.address)
    with _one_at_a_time, threadpool_limits(1):
        say(_BEGUN, (key, worker.address))
        return pickle.dumps(work.do(pickle.loads(content), tell))


def _check_code(wanted: str, address: str) -> None:
    """Refuse to work where the code is another; a worker may have come after the versions were compared."""
    if installation() != wanted:
        evidence = f"the worker {address} has other files of dynident, or other versions"
        raise PoolFailed("the cluster", evidence, "install the same on all workers, and start them anew")
