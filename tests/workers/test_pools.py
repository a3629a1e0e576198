"""Pools: the same results here, in processes and on a cluster; late tasks, lost workers, other versions."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from dynident.cli.jobs import cluster_of
from dynident.errors import BadOption, LogMismatch, PoolFailed
from dynident.workers import dask_pool
from dynident.workers.dask_pool import DaskPool
from dynident.workers.processes import Done, Here, Pool, Processes, Tell, local_pool, uninterrupted_start


@dataclass(frozen=True)
class Squares:
    """Squares numbers, and does odd things where it is told to."""

    folder: str = ""

    def prepare(self) -> None:
        """Do nothing."""

    def do(self, task: Any, tell: Tell) -> Any:
        """Return the square of a number."""
        if task == "raise":
            raise LogMismatch("a.csv", "it is odd", "mend it")
        if task == "sleep":
            time.sleep(600)
        if task == "work for ever":
            while True:
                pass
        if task == "rest":
            time.sleep(1.0)
        if task == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if task == "die once" and not (mark := Path(self.folder) / "died").exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        tell(("seen", task))
        return task**2 if isinstance(task, int) else task


@pytest.fixture(scope="module")
def inside() -> Iterator[DaskPool]:
    """A cluster within this process, reached by its address."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        processes=False, n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0", protocol="inproc"
    ) as cluster:
        yield DaskPool(cluster.scheduler_address)


@pytest.fixture(params=["here", "processes", "cluster"])
def pool(request: pytest.FixtureRequest) -> Pool:
    """Each kind of pool."""
    if request.param == "cluster":
        return request.getfixturevalue("inside")
    return Here() if request.param == "here" else Processes(2)


def test_every_task_ends_once_and_is_told(pool: Pool) -> None:
    begun, news = list[Any](), list[Any]()
    ended = list(pool.run(Squares(), range(7), begins=begun.append, news=news.append))
    assert sorted((done.task, done.result) for done in ended) == [(k, k * k) for k in range(7)]
    assert sorted(begun) == list(range(7)) and sorted(news) == [("seen", k) for k in range(7)]
    assert all(not done.failure and not done.late and done.seconds >= 0 for done in ended)
    assert list(pool.run(Squares(), ())) == []


def test_tasks_are_taken_when_there_is_room_after_the_results_before(pool: Pool) -> None:
    """So that a search can stop handing out starts when it has what it needs."""
    taken, seen = list[int](), list[Done]()

    def tasks() -> Iterator[int]:
        for k in range(100):
            if len(seen) >= 3:
                return
            taken.append(k)
            yield k

    for done in pool.run(Squares(), tasks()):
        seen.append(done)
    assert len(taken) == len(seen) <= 5


def test_what_work_raises_is_raised(pool: Pool) -> None:
    with closing(pool.run(Squares(), ["raise"])) as ended, pytest.raises(LogMismatch, match="it is odd") as caught:
        list(ended)
    assert caught.value.step == "mend it"
    assert not multiprocessing.active_children()


def test_a_process_that_dies_or_is_late_fails_and_the_others_go_on() -> None:
    ended = {done.task: done for done in Processes(2).run(Squares(), ["die", "sleep", 3, 4], time_limit=3.0)}
    assert ended["die"].failure == "its process ended with code -9: out of memory?" and not ended["die"].late
    assert ended["sleep"].failure == "ended at the time limit of 3 s" and ended["sleep"].late
    assert ended[3].result == 9 and ended[4].result == 16
    assert not multiprocessing.active_children()


def test_a_limit_of_the_processor_time_counts_work_and_not_waiting() -> None:
    tasks = ["rest", "work for ever", 3]
    ended = {done.task: done for done in Processes(1, 0.5).run(Squares(), tasks)}
    assert ended["rest"].result == "rest" and ended["rest"].seconds > 0.9 and not ended["rest"].late
    assert ended["work for ever"].failure == "ended after 0.5 s of processor time" and ended["work for ever"].late
    assert ended[3].result == 9
    assert not multiprocessing.active_children()


def test_a_system_without_such_a_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(signal, "setitimer")
    with pytest.raises(BadOption, match="this system does not end processes by their processor time"):
        local_pool(1, processor_limit=1.0)


class Interrupted(Squares):
    """Interrupts the process that loads it, as a terminal does with all processes of a command."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _interrupted_while_loading, ()


def _interrupted_while_loading() -> Squares:
    os.kill(os.getpid(), signal.SIGINT)
    return Squares()


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="signals of POSIX")
def test_a_process_that_is_interrupted_while_it_starts_goes_on() -> None:
    assert [done.result for done in Processes(1).run(Interrupted(), [3])] == [9]


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Let SIGINT raise KeyboardInterrupt, also where the tests run as a background job of a shell, which ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_during_a_start_takes_effect_after_it() -> None:
    before, steps = signal.getsignal(signal.SIGINT), list[str]()
    with pytest.raises(KeyboardInterrupt):
        with uninterrupted_start():
            signal.raise_signal(signal.SIGINT)
            steps.append("started")
        steps.append("not reached")
    assert steps == ["started"] and signal.getsignal(signal.SIGINT) is before
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_that_another_thread_takes_is_delayed_too() -> None:
    with pytest.raises(KeyboardInterrupt):
        ready, steps = threading.Event(), list[str]()
        other = threading.Thread(target=lambda: ready.wait() and signal.raise_signal(signal.SIGINT))
        other.start()  # before the start, so that it does not inherit the mask
        with uninterrupted_start():
            ready.set()
            other.join()
            steps.append("started")
    assert steps == ["started"]


def test_options_that_cannot_be() -> None:
    for jobs, limit in ((0, None), (1, 0.0), (1, float("nan"))):
        with pytest.raises(BadOption):
            local_pool(jobs, limit)
    with pytest.raises(BadOption, match="processor limit"):
        local_pool(1, processor_limit=-1.0)
    assert isinstance(local_pool(1), Here) and local_pool(1, 5.0) == Processes(1)
    assert local_pool(1, processor_limit=5.0) == Processes(1, 5.0)
    with pytest.raises(BadOption, match="take processes"):
        list(Here().run(Squares(), [1], time_limit=1.0))
    for scheduler in ("nowhere", "local:0", "local:x", "", "localhost:8786"):
        with pytest.raises(BadOption, match="local:N"):
            DaskPool(scheduler)
    options = type("Options", (), {"scheduler": "local:2", "jobs": 2})
    with pytest.raises(BadOption, match="give one of the two"):
        cluster_of(options)  # type: ignore[arg-type]


def test_a_scheduler_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(dask_pool, "PATIENCE_S", 0.2)
    with pytest.raises(BadOption, match=r"no Dask scheduler answers there \(Timed out"):
        list(DaskPool("tcp://127.0.0.1:1").run(Squares(), [1]))


def test_a_cluster_without_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(dask_pool, "WORKERS_S", 0.2)
    settings: dict[str, Any] = {"n_workers": 0, "dashboard_address": "127.0.0.1:0", "protocol": "inproc"}
    with distributed.LocalCluster(processes=False, **settings) as cluster:
        with pytest.raises(PoolFailed, match=r"no worker in 0\.2 s; start one: dask worker inproc://"):
            list(DaskPool(cluster.scheduler_address).run(Squares(), [1]))


def test_a_cluster_that_loses_all_its_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(dask_pool, "LOST_S", 0.5)
    settings: dict[str, Any] = {"n_workers": 1, "dashboard_address": "127.0.0.1:0", "protocol": "inproc"}
    with distributed.LocalCluster(processes=False, **settings) as cluster:

        def tasks() -> Iterator[int]:
            yield 1
            cluster.scale(0)
            while cluster.scheduler.workers:
                time.sleep(0.05)
            yield 2

        ended = DaskPool(cluster.scheduler_address).run(Squares(), tasks())
        assert next(ended).result == 1
        with pytest.raises(PoolFailed, match=r"all its workers are gone, for 0\.5 s; start workers anew"):
            list(ended)


def test_workers_with_other_versions_are_refused(inside: DaskPool, monkeypatch: pytest.MonkeyPatch) -> None:
    told = dask_pool.package_versions()
    monkeypatch.setattr(dask_pool, "package_versions", lambda: told | {"numpy": "1.0"})
    with pytest.raises(PoolFailed, match=r"other versions than here: numpy [\d.]+, here 1\.0 \(on inproc"):
        list(inside.run(Squares(), [1]))
    monkeypatch.undo()
    own = dask_pool.installation()
    answers = iter([own[::-1]])  # what is sent with the task; the worker, in this process, says its own
    monkeypatch.setattr(dask_pool, "installation", lambda: next(answers, own))
    with pytest.raises(PoolFailed, match="has other files of dynident, or other versions"):
        list(inside.run(Squares(), [1]))


def test_versions_name_what_changes_bits() -> None:
    told = dask_pool.package_versions()
    assert set(told) == {*dask_pool.PACKAGES, "python"} and all(told[name] for name in ("dynident", "numpy", "python"))
    assert dask_pool.installation() == dask_pool.installation() and len(dask_pool.installation()) == 64


@pytest.mark.battery
def test_a_cluster_of_processes_loses_workers_and_ends_late_tasks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Dask gives up workers that are not back in a time, as on a machine under load: here in a tenth of a second."""
    pytest.importorskip("distributed")
    import dask.config

    monkeypatch.setattr(dask_pool, "LOST_S", 120.0)
    tasks = ["die once", 3, "sleep", 4, 5]
    with dask.config.set({"distributed.deploy.lost-worker-timeout": "100ms"}):
        ended = {done.task: done for done in DaskPool("local:2").run(Squares(str(tmp_path)), tasks, time_limit=20.0)}
    assert (tmp_path / "died").exists() and ended["die once"].result == "die once"
    assert ended["sleep"].late and ended["sleep"].failure == "ended at the time limit of 20 s"
    assert [ended[k].result for k in (3, 4, 5)] == [9, 16, 25]
    (done,) = DaskPool("local:1").run(Squares(), ["die"])
    assert "workers died of it: out of memory?" in done.failure
