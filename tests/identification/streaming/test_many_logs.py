"""Many logs by many workers: the same bits as one after the other, each log once, bad ones named, work kept."""

from __future__ import annotations

import itertools
import json
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident.api.case_logs import logs_named
from dynident.api.matching_digests import merged_file
from dynident.case.case import Case, read_case
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.data.log_places import at_hand, size_of
from dynident.errors import DynidentError, FileError, LogFormatError, LogMismatch, MissingDependency, PoolFailed
from dynident.identification.streaming import reduction
from dynident.identification.streaming.digest import Digest, MergeTree
from dynident.identification.streaming.one_log import Checkpoint
from dynident.identification.streaming.reduction import Standing, reduce_logs
from dynident.identification.streaming.triangle_file import read_digest, write_digest
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.robot import Robot
from dynident.workers.dask_pool import DaskPool
from dynident.workers.processes import Done, Pool, Processes

NAMES = "abcdefg"


# --- the tree ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Text:
    """Stands for a digest: merging shows in which order it was done."""

    text: str

    def merged(self, other: Text) -> Text:
        return Text(f"({self.text} {other.text})")


def by_definition(texts: list[str | None]) -> str | None:
    """Return the tree as the module states it."""
    if len(texts) == 1:
        return texts[0]
    cut = 1 << (len(texts) - 1).bit_length() - 1
    first, second = by_definition(texts[:cut]), by_definition(texts[cut:])
    return f"({first} {second})" if first and second else first or second


@given(st.data(), st.lists(st.booleans(), min_size=1, max_size=40), st.integers(0, 4))
def test_the_tree_is_the_same_in_any_order_and_in_any_blocks(
    data: st.DataObject, sound: list[bool], level: int
) -> None:
    texts: list[str | None] = [str(k) if one else None for k, one in enumerate(sound)]
    size, tree = 1 << level, MergeTree()
    starts = data.draw(st.permutations(range(0, len(texts), size)))
    for first in starts:
        part = by_definition(texts[first : first + size])
        tree.add(first, size, None if part is None else Text(part))  # type: ignore[arg-type]
        with pytest.raises(ValueError, match=f"position {first} has been taken"):
            tree.add(first, size, None)
    found: Any = tree.merged()
    assert (found and found.text) == by_definition(texts)


def test_positions_that_are_no_block_are_refused() -> None:
    for first, size in ((1, 2), (0, 3), (6, 4)):
        with pytest.raises(ValueError, match="no block of the tree"):
            MergeTree().add(first, size, None)


# --- logs --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, planar_2r: Robot, exact_log: Callable[..., Log]) -> Path:
    """A folder with a robot, a case, and a folder of seven logs."""
    place = tmp_path_factory.mktemp("cell")
    (place / "logs").mkdir()
    (place / "arm.json").write_text(json.dumps(robot_to_dict(planar_2r)))
    how = "preprocessing: {filter: {butterworth: {cutoff_hz: 5}}, rate_hz: 50}"
    (place / "case.yaml").write_text(f"case: 1\nrobot: arm.json\n{how}\n")
    case = read_case(place / "case.yaml")
    theta = np.append(planar_2r.nominal, np.tile([0.5, 0.3, 0.1], 2))  # type: ignore[arg-type]
    for seed, name in enumerate(NAMES):
        log = exact_log(case.model, theta, noise=0.2, seed=seed, samples=1000 + 100 * seed, rate=100.0)
        write_log(Log(log.joints, log.time, log.q, torque=log.torque), place / "logs" / f"{name}.npz")
    return place


@pytest.fixture(scope="module")
def case(folder: Path) -> Case:
    return read_case(folder / "case.yaml")


@pytest.fixture(scope="module")
def logs(folder: Path) -> list[Path]:
    return [folder / "logs" / f"{name}.npz" for name in NAMES]


@pytest.fixture(scope="module")
def whole(case: Case, logs: list[Path]) -> Digest:
    """All logs reduced one after the other."""
    return reduce_logs(case.stream_setup(), logs)


@pytest.fixture(scope="module")
def elsewhere() -> Iterator[DaskPool]:
    """A cluster within this process, that counts as one elsewhere: it is reached by its address."""
    distributed = pytest.importorskip("distributed")
    settings: dict[str, Any] = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
    with distributed.LocalCluster(processes=False, protocol="inproc", **settings) as cluster:
        yield DaskPool(cluster.scheduler_address)


def content(digest: Digest, folder: Path) -> dict[str, bytes]:
    """Return all that a triangle file holds."""
    write_digest(digest, folder / "content.tri")
    with np.load(folder / "content.tri") as archive:
        return {name: archive[name].tobytes() for name in archive.files}


@pytest.mark.parametrize("parts", [256, 1])
def test_a_cluster_gives_the_bits_of_one_after_the_other(
    parts: int, case: Case, logs: list[Path], whole: Digest, elsewhere: DaskPool, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr(reduction, "PARTS", parts)  # 1: blocks of four, which workers merge
    states, told = list[Standing](), list[str]()
    found = reduce_logs(case.stream_setup(), logs, told.append, pool=elsewhere, standing=states.append)
    assert content(found, tmp_path) == content(whole, tmp_path)
    assert states[-1] == Standing(1.0, 7, 7) and [s.finished for s in states] == sorted(s.finished for s in states)
    assert all(any(f"{log}: 100 % of" in text for text in told) for log in logs)


def test_processes_give_the_same_bits_and_keep_their_work(
    case: Case, logs: list[Path], whole: Digest, tmp_path: Path
) -> None:
    checkpoint = Checkpoint(tmp_path / "out.tri")
    found = reduce_logs(case.stream_setup(), logs[:3], checkpoint=checkpoint, pool=Processes(2))
    assert content(found, tmp_path) == content(reduce_logs(case.stream_setup(), logs[:3]), tmp_path)
    assert sorted(file.name for file in tmp_path.glob("*.partial")) == [f"out.tri.{k}.partial" for k in range(3)]
    told: list[str] = []
    again = reduce_logs(case.stream_setup(), logs, told.append, checkpoint)  # by another pool, with more logs
    assert content(again, tmp_path) == content(whole, tmp_path)
    assert sum("100 % of" in text for text in told) == 4


class Lossy(Pool):
    """A pool that runs tasks here, in any order, and does something with their results."""

    is_local = False

    def __init__(self, change: Callable[[list[Done]], list[Done]]) -> None:
        self._change = change

    def run(self, work: Any, tasks: Any, **told: Any) -> Any:
        """Yield the changed results."""
        yield from self._change([Done(task, 0.0, work.do(task, told["news"])) for task in tasks])


def test_parts_in_any_order_and_none_twice(case: Case, logs: list[Path], tmp_path: Path) -> None:
    wanted = content(reduce_logs(case.stream_setup(), logs[:4]), tmp_path)
    for order in ([3, 1, 2, 0], [0, 2, 3, 1]):
        found = reduce_logs(
            case.stream_setup(), logs[:4], pool=Lossy(lambda done, order=order: [done[k] for k in order])
        )
        assert content(found, tmp_path) == wanted
    with pytest.raises(LogMismatch, match=r"the same content as .*a\.npz"):
        reduce_logs(case.stream_setup(), logs[:3], pool=Lossy(lambda done: [*done, done[0]]))
    with pytest.raises(PoolFailed, match=r"sent QR factors of \['.*b\.npz'\] for \['.*a\.npz'\]"):
        reduce_logs(case.stream_setup(), logs[:2], pool=Lossy(lambda done: [replace(done[0], result=done[1].result)]))
    with pytest.raises(PoolFailed, match=r"a\.npz: two workers died; give the same command again"):
        reduce_logs(
            case.stream_setup(), logs[:2], pool=Lossy(lambda done: [replace(done[0], failure="two workers died")])
        )


def test_a_part_that_never_comes_is_missed(case: Case, logs: list[Path]) -> None:
    with pytest.raises(PoolFailed, match=r"2 of 3 logs came back"):
        reduce_logs(case.stream_setup(), logs[:3], pool=Lossy(lambda done: done[:2]))


def test_rows_that_are_lost_or_count_twice_are_seen(whole: Digest, tmp_path: Path) -> None:
    joint = whole.joints[0]
    with pytest.raises(ValueError, match=r"the QR factors of joint1 have \d+ rows, its logs \d+"):
        replace(whole, joints=(replace(joint, counts=joint.counts[1:]), *whole.joints[1:]))
    with pytest.raises(ValueError, match=r"the log .*a\.npz counts twice"):
        whole.merged(whole)


def test_work_of_a_cluster_is_kept_here(
    case: Case, logs: list[Path], whole: Digest, elsewhere: DaskPool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reduction, "PARTS", 1)
    checkpoint = Checkpoint(tmp_path / "out.tri")

    def stop(state: Standing) -> None:
        if state.finished:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reduce_logs(case.stream_setup(), logs, checkpoint=checkpoint, pool=elsewhere, standing=stop)
    (kept,) = [file.name for file in tmp_path.iterdir()]
    assert len(read_digest(tmp_path / kept).chunks) == (4 if ".0." in kept else 3)
    told: list[str] = []
    found = reduce_logs(case.stream_setup(), logs, told.append, checkpoint, pool=elsewhere)
    assert content(found, tmp_path) == content(whole, tmp_path)
    assert sum("100 % of" in text for text in told) == (3 if ".0." in kept else 4)
    checkpoint.file(0).write_bytes(b"damaged")
    assert content(reduce_logs(case.stream_setup(), logs, checkpoint=checkpoint, pool=elsewhere), tmp_path) == content(
        whole, tmp_path
    )


def test_bad_logs_are_named_all_and_left_out_on_request(
    case: Case, logs: list[Path], elsewhere: DaskPool, tmp_path: Path
) -> None:
    (tmp_path / "cut.npz").write_bytes(logs[0].read_bytes()[:900])
    (tmp_path / "short.csv").write_text("t,q1\n0,1\n")
    names = [tmp_path / "cut.npz", logs[0], tmp_path / "short.csv", logs[1], tmp_path / "none.npz"]
    words = (
        r"3 of 5 logs: they cannot be compressed: .*cut\.npz: no NumPy.*short\.csv:1: no column.*"
        r"none\.npz: .*--skip-bad"
    )
    for pool in (None, elsewhere):
        with pytest.raises(LogMismatch, match=words):
            reduce_logs(case.stream_setup(), names, pool=pool)
        bad: dict[str, DynidentError] = {}
        found = reduce_logs(case.stream_setup(), names, pool=pool, skipped=bad.__setitem__)
        assert [chunk.path for chunk in found.chunks] == [str(logs[0]), str(logs[1])]
        assert [Path(name).name for name in bad] == ["cut.npz", "short.csv", "none.npz"]
    with pytest.raises(LogFormatError, match=r"short\.csv:1: no column"):
        reduce_logs(case.stream_setup(), names[1:3])
    with pytest.raises(LogMismatch, match="3 of 3 logs"):
        reduce_logs(case.stream_setup(), names[::2], skipped=lambda name, error: None)
    with pytest.raises(LogMismatch, match="the same content as"):
        reduce_logs(case.stream_setup(), [logs[0], logs[1], logs[0]], skipped=lambda name, error: None)


def test_a_log_that_only_this_machine_sees(case: Case, logs: list[Path]) -> None:
    lost = [(0, FileError(str(logs[0]), "there is no such file", "check the path"))]

    def blind(done: list[Done]) -> list[Done]:
        return [replace(done[0], result=replace(done[0].result, digest=None, bad=tuple(lost)))]

    with pytest.raises(FileError, match=r"a\.npz: there is no such file where the worker runs; put logs where all"):
        reduce_logs(case.stream_setup(), logs[:1], pool=Lossy(blind))


def test_files_merge_to_the_same_bits_in_any_order(case: Case, logs: list[Path], whole: Digest, tmp_path: Path) -> None:
    parts = []
    for k, group in enumerate((logs[:1], logs[1:2], logs[2:4])):
        write_digest(reduce_logs(case.stream_setup(), group), tmp_path / f"{k}.tri")
        parts.append(tmp_path / f"{k}.tri")
    wanted = content(merged_file(parts), tmp_path)
    for order in itertools.permutations(parts):
        assert content(merged_file(order), tmp_path) == wanted


# --- names and addresses -------------------------------------------------------------------------------------------


def test_folders_patterns_and_what_is_no_log(folder: Path, case: Case, tmp_path: Path, logs: list[Path]) -> None:
    for name in ("b.csv", "a.npz", "notes.md", "case.yaml"):
        (tmp_path / name).write_text("x")
    (tmp_path / "deeper").mkdir()
    found, others = logs_named([str(tmp_path), "one.csv"], case.find)
    assert [Path(name).name for name in found] == ["a.npz", "b.csv", "one.csv"]
    assert [Path(name).name for name in others] == ["case.yaml", "notes.md"]
    assert logs_named(["logs/[a-c].npz"], case.find)[0] == [str(log) for log in logs[:3]]  # beside the case file
    for name in ("logs/*.csv", str(tmp_path / "deeper"), str(tmp_path / "*.md")):
        with pytest.raises(FileError, match=r"no log|none of which is a log"):
            logs_named([name], case.find)
    with at_hand("b.csv", str(tmp_path)) as path, at_hand(str(logs[0]), str(tmp_path)) as absolute:
        assert path == tmp_path / "b.csv" and absolute == logs[0]
    assert size_of(str(logs[0])) == logs[0].stat().st_size and size_of(str(tmp_path / "none.csv")) == 0


def test_logs_at_addresses_are_those_of_the_folder(
    case: Case, logs: list[Path], elsewhere: DaskPool, tmp_path: Path
) -> None:
    fsspec = pytest.importorskip("fsspec")
    bucket = fsspec.filesystem("memory")
    for log in logs[:3]:
        bucket.pipe(f"/bucket/{log.name}", log.read_bytes())
    bucket.pipe("/bucket/readme.md", b"x")
    names, others = logs_named(["memory://bucket"], case.find)
    assert [name.rpartition("/")[2] for name in names] == ["a.npz", "b.npz", "c.npz"] and len(others) == 1
    assert logs_named(["memory://bucket/*.npz"], case.find)[0] == names
    found = reduce_logs(case.stream_setup(), names, pool=elsewhere)
    assert [chunk.path for chunk in found.chunks] == names
    wanted, same = content(reduce_logs(case.stream_setup(), logs[:3]), tmp_path), content(found, tmp_path)
    assert {k: v for k, v in same.items() if k != "about"} == {k: v for k, v in wanted.items() if k != "about"}
    bucket.pipe("/bucket/cut.npz", b"not an archive")
    with pytest.raises(LogFormatError, match=r"^memory://.*bucket/cut\.npz: no NumPy archive") as caught:
        reduce_logs(case.stream_setup(), [*names, "memory://bucket/cut.npz"], pool=elsewhere)
    assert str(tmp_path.parent) not in str(caught.value) and caught.value.path == "memory://bucket/cut.npz"
    for name in ("memory://bucket/none.npz", "nosuch://bucket/a.npz"):
        with pytest.raises(FileError, match=r"cannot be reached \("):
            reduce_logs(case.stream_setup(), [name])


def test_an_address_without_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "fsspec.core", None)
    with pytest.raises(MissingDependency, match=r"pip install 'dynident\[dask\]'"), at_hand("s3://bucket/a.csv"):
        pass


# --- lost workers ---------------------------------------------------------------------------------------------------


@pytest.mark.battery
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal here")
def test_workers_killed_on_the_way_cost_time_and_change_no_bit(
    case: Case, logs: list[Path], whole: Digest, tmp_path: Path
) -> None:
    """Kill every worker of a cluster once, each in the middle of a log."""
    distributed = pytest.importorskip("distributed")
    killed: list[int] = []
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster:

        def kill(text: str) -> None:
            if "% of" in text and len(killed) < 2:
                pids = [nanny.pid for nanny in cluster.workers.values() if nanny.pid and nanny.pid not in killed]
                os.kill(pids[0], signal.SIGKILL)
                killed.append(pids[0])

        found = reduce_logs(case.stream_setup(), logs, kill, pool=DaskPool(cluster.scheduler_address))
    assert len(killed) == 2
    assert content(found, tmp_path) == content(whole, tmp_path)


@pytest.mark.battery
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal here")
def test_processes_killed_on_the_way_fail_and_the_command_goes_on(
    case: Case, logs: list[Path], whole: Digest, tmp_path: Path
) -> None:
    import multiprocessing

    killed: list[int] = []

    def kill() -> None:
        while not (own := multiprocessing.active_children()):
            time.sleep(0.01)
        time.sleep(0.5)
        os.kill(own[0].pid or 0, signal.SIGKILL)
        killed.append(own[0].pid or 0)

    checkpoint = Checkpoint(tmp_path / "out.tri", 0.0)
    threading.Thread(target=kill).start()
    try:
        found = reduce_logs(case.stream_setup(), logs, checkpoint=checkpoint, pool=Processes(2))
    except PoolFailed:
        found = reduce_logs(case.stream_setup(), logs, checkpoint=checkpoint, pool=Processes(2))
    assert len(killed) == 1
    assert content(found, tmp_path) == content(whole, tmp_path)
