"""Logs reduced window by window: the estimate, the figures and the errors of the whole log in memory."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.api.matching_digests import check_case
from dynident.arrays import Array
from dynident.case.case import Case, read_case
from dynident.data.formats import write_log
from dynident.data.formats._stream import LogStream
from dynident.data.log import Log
from dynident.data.preprocessing import FILTERS, Preprocessing
from dynident.errors import BadOption, LogMismatch
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.identify import identify
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.streaming import digest, windows
from dynident.identification.streaming.estimate import identify_digest
from dynident.identification.streaming.one_log import reduce_log
from dynident.identification.streaming.reduction import reduce_logs
from dynident.identification.streaming.time_scan import StreamedMedian
from dynident.model.base_parameters import base_parameters
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.robot import Robot

MakeLog = Callable[..., Log]


@pytest.fixture
def case(tmp_path: Path, planar_2r: Robot, monkeypatch: pytest.MonkeyPatch) -> Case:
    """A case whose logs are cut into many windows."""
    monkeypatch.setattr(windows, "TILE", 1)
    (tmp_path / "arm.json").write_text(json.dumps(robot_to_dict(planar_2r)))
    fast = FILTERS.make("butterworth", {"cutoff_hz": 5.0})
    how = Preprocessing(fast, rate_hz=200.0, trim_s=0.5, standstill=0.3)  # many rows are at rest
    return replace(read_case(tmp_path / "arm.json"), preprocessing=how)


@pytest.fixture
def make(case: Case, exact_log: MakeLog, tmp_path: Path) -> Callable[..., Path]:
    """Write a noisy log; its time may jitter, and rows may be missing."""

    def write(name: str, seed: int = 0, samples: int = 14_000, jitter: float = 0.0, cut: slice | None = None) -> Path:
        theta = np.append(case.robot.nominal, np.tile([0.5, 0.3, 0.1], 2))  # type: ignore[arg-type]
        log = exact_log(case.model, theta, noise=0.2, seed=seed, samples=samples, rate=200.0)
        generator = np.random.default_rng(seed)
        time = log.time + jitter * generator.uniform(-0.5, 0.5, samples) / 200.0
        found = Log(log.joints, time, log.q + 1e-5 * generator.normal(size=log.q.shape), torque=log.torque)
        if cut is not None:
            found = found.rows(np.delete(np.arange(samples), cut), "gap")
        write_log(found, tmp_path / name)
        return tmp_path / name

    return write


def in_memory(case: Case, logs: list[Path], estimator: str) -> Estimate:
    return identify(case.model, [case.read(log) for log in logs], estimator, case.preprocessing)


def assert_same(found: Estimate, wanted: Estimate) -> None:
    """Check the estimate and all figures that are over all rows."""
    assert found.samples == wanted.samples and found.base.names == wanted.base.names
    assert np.linalg.norm(found.beta - wanted.beta) < 1e-9 * np.linalg.norm(wanted.beta)
    np.testing.assert_allclose(found.joint_deviations, wanted.joint_deviations, rtol=1e-9)
    fits = (*found.train.joints, *found.train.moving), (*wanted.train.joints, *wanted.train.moving)
    for ours, theirs in zip(*fits, strict=True):
        assert ours.name == theirs.name and ours.samples == theirs.samples
        for name in ("rmse", "rmse_unfiltered", "correlation", "r2", "relative_error", "deviation"):
            assert getattr(ours, name) == pytest.approx(getattr(theirs, name), rel=1e-8)
    assert found.train.total_relative_error == pytest.approx(wanted.train.total_relative_error, rel=1e-8)
    assert found.envelope is not None and wanted.envelope is not None
    np.testing.assert_allclose(found.envelope.low, wanted.envelope.low, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(found.envelope.high, wanted.envelope.high, rtol=1e-8, atol=1e-8)
    assert found.envelope.furthest == pytest.approx(wanted.envelope.furthest, rel=1e-5)


HOW: dict[str, dict[str, Any]] = {
    "default": {},
    "every row, rest kept": {"rate_hz": None, "rest": "keep", "trim_s": 0.0},
    "motion later": {"delay_s": 0.0137},
    "motion earlier": {"delay_s": -0.031, "trim_s": 1.234, "rate_hz": 66.0},
    "slow filter": {"filter": FILTERS.make("butterworth", {"cutoff_hz": 1.5})},
    "torque raw": {"filter": FILTERS.make("butterworth", {"cutoff_hz": 5.0, "torque": "none"})},
    "rows by the cut-off": {"rows_per_period": 8.0},
    "five points": {"filter": FILTERS.make("five_point", {"repeats": 20})},
}


@pytest.mark.parametrize("how", HOW)
def test_windows_are_the_whole_log(how: str, case: Case, make: Callable[..., Path]) -> None:
    case = replace(case, preprocessing=replace(case.preprocessing, **HOW[how]))
    logs = [make("run.npz")]
    assert_same(identify_digest(reduce_logs(case.stream_setup(), logs), "wls"), in_memory(case, logs, "wls"))


@pytest.mark.parametrize(("jitter", "cut"), [(0.4, None), (0.0, slice(9000, 9030)), (0.3, slice(4000, 4008))])
def test_time_that_is_not_even(jitter: float, cut: slice | None, case: Case, make: Callable[..., Path]) -> None:
    logs = [make("run.csv", jitter=jitter, cut=cut)]
    wanted = in_memory(case, logs, "wls")
    reduced = reduce_logs(case.stream_setup(), logs)
    assert_same(identify_digest(reduced, "wls"), wanted)
    steps = wanted.provenance["logs"][0]["steps"]
    assert [step for step in reduced.chunks[0].steps if "resampled" in step] == [s for s in steps if "resampled" in s]


@pytest.mark.parametrize(("jitter", "cut"), [(0.0, None), (0.4, slice(2090, 2120))], ids=["even", "jitter and a gap"])
@pytest.mark.parametrize("rows", [40, 1999])
def test_the_blocks_in_which_a_log_is_read_do_not_matter(
    rows: int, jitter: float, cut: slice | None, case: Case, make: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Logs longer than one block: the grid goes on over their seams, and so does the look for gaps."""
    logs = [make("run.npz", samples=4000, jitter=jitter, cut=cut)]
    wanted = in_memory(case, logs, "wls")
    for name in ("times", "blocks"):
        monkeypatch.setattr(getattr(LogStream, name), "__defaults__", (rows,))
    assert_same(identify_digest(reduce_logs(case.stream_setup(), logs), "wls"), wanted)


def test_a_turn_between_two_blocks_is_seen(
    case: Case, make: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = case.read(make("run.npz", samples=4000))
    q = np.array(log.q)
    q[1400:, 0] -= 2 * np.pi
    write_log(replace(log, q=q), tmp_path / "turned.npz")
    monkeypatch.setattr(LogStream.blocks, "__defaults__", (700,))
    with pytest.raises(LogMismatch, match="positions jump by a whole turn between two samples: joint1 once"):
        reduce_logs(case.stream_setup(), [tmp_path / "turned.npz"])


@pytest.mark.parametrize("estimator", ["ols", "consistent", "log_cholesky", "ridge"])
def test_estimators_of_triangles_say_the_same_over_several_logs(
    estimator: str, case: Case, make: Callable[..., Path]
) -> None:
    logs = [make("a.npz", 0), make("b.npz", 1, 6000), make("c.npz", 2, 5000)]
    found, wanted = identify_digest(reduce_logs(case.stream_setup(), logs), estimator), in_memory(case, logs, estimator)
    # Ridge asks for correlation factors, which stretches know in another way than rows.
    # The conic solver of the consistent fit ends where it may by its own tolerance.
    tolerance = {"ridge": 1e-3, "consistent": 1e-5}.get(estimator, 1e-6)
    assert np.linalg.norm(found.beta - wanted.beta) < tolerance * np.linalg.norm(wanted.beta)
    assert np.all(np.abs(np.log(found.std / wanted.std)) < np.log(2.5))
    assert found.train.starts[0] == 0 and len(found.train.starts) == 3
    assert [log["path"] for log in found.provenance["logs"]] == [str(log) for log in logs]


def test_a_cut_off_that_is_left_open_is_that_of_the_log(case: Case, make: Callable[..., Path]) -> None:
    case = replace(case, preprocessing=replace(case.preprocessing, filter=FILTERS.make("butterworth")))
    logs = [make("run.npz", samples=8000)]
    found, wanted = identify_digest(reduce_logs(case.stream_setup(), logs), "wls"), in_memory(case, logs, "wls")
    assert found.preprocessing.filter == wanted.preprocessing.filter
    assert_same(found, wanted)


def test_a_delay_that_is_left_open_is_that_of_the_log(case: Case, make: Callable[..., Path]) -> None:
    case = replace(case, preprocessing=replace(case.preprocessing, delay_s=None))
    log = make("run.npz", samples=8000)
    raw = case.read(log)
    late = np.roll(np.asarray(raw.torque), 3, axis=0)[3:]  # three samples behind the positions
    np.savez(log, t=raw.time[3:], q=raw.q[3:], tau=late)
    digest = reduce_logs(case.stream_setup(), [log])
    assert digest.how.delay_s == pytest.approx(3 / raw.rate, abs=0.1 / raw.rate)
    check_case(digest, "part.tri", case.model, case.preprocessing)
    assert_same(identify_digest(digest, "wls"), in_memory(case, [log], "wls"))


def test_threads_do_not_change_a_bit(case: Case, make: Callable[..., Path]) -> None:
    path = make("run.npz", samples=4000)
    base = base_parameters(case.model)
    one, three = (
        reduce_log(
            case.stream_setup(), path, RegressorStream(case.model, base), lambda step, share: None, None, 0, threads
        )
        for threads in (1, 3)
    )
    for ours, wanted in zip(three.joints, one.joints, strict=True):
        assert ours.factors.tobytes() == wanted.factors.tobytes() and ours.counts.sum() > 0
    assert three.sampled.rows[0].tobytes() == one.sampled.rows[0].tobytes()


def test_few_stretches_are_merged_and_the_estimate_stays(
    case: Case, make: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    logs = [make("run.npz")]
    whole = identify_digest(reduce_logs(case.stream_setup(), logs), "wls")
    for module in (digest, __import__("dynident.identification.streaming.tally", fromlist=["MOST"])):
        monkeypatch.setattr(module, "MOST", 7)
    reduced = reduce_logs(case.stream_setup(), logs)
    found = identify_digest(reduced, "wls")
    assert_same(found, whole)
    assert 7 <= len(reduced.joints[0].counts) <= 15
    assert sum(reduced.joints[0].counts) + reduced.joints[0].rested == whole.samples


@pytest.mark.battery
def test_intervals_cover_the_truth_under_coloured_noise(case: Case, exact_log: MakeLog, tmp_path: Path) -> None:
    """Stretches carry the colour of the residual: 95 % intervals hold the truth in about 95 % of the cases."""
    theta = np.append(case.robot.nominal, np.tile([0.5, 0.3, 0.1], 2))  # type: ignore[arg-type]
    case = replace(case, preprocessing=replace(case.preprocessing, filter=FILTERS.make("as_given"), rest="keep"))
    names = {name: tuple(f"{word}{k}" for k in (1, 2)) for name, word in (("dq", "dq"), ("ddq", "ddq"))}
    case = replace(case, columns=replace(case.columns, **names))
    clean = exact_log(case.model, theta, samples=5000, rate=100.0)
    inside: list[Array] = []
    for seed in range(25):
        white = np.random.default_rng(seed).normal(size=(clean.samples + 50, 2))
        noise = np.apply_along_axis(lambda x: np.convolve(x, 0.9 ** np.arange(51), "valid"), 0, white)
        write_log(replace(clean, torque=np.asarray(clean.torque) + noise), tmp_path / "run.npz")
        reduced = reduce_logs(case.stream_setup(), [tmp_path / "run.npz"])
        found = identify_digest(reduced, "wls")
        inside.append(np.abs(found.beta - found.base.from_standard(theta)) <= found.half_widths())  # pyright: ignore
    assert 0.90 < np.mean(inside) < 0.985


def test_what_needs_all_rows_is_refused_in_words(case: Case, make: Callable[..., Path], tmp_path: Path) -> None:
    log = make("run.npz", samples=4000)
    whole = FILTERS.make("fourier_fit", {"period_s": 5.0})
    for how, words in (({"filter": whole}, "the filter 'fourier_fit' needs the whole log at once"),):
        changed = replace(case, preprocessing=replace(case.preprocessing, **how))  # type: ignore[arg-type]
        with pytest.raises(LogMismatch, match=words):
            reduce_logs(changed.stream_setup(), [log])
    with pytest.raises(LogMismatch, match="friction: auto needs all samples"):
        reduce_logs(replace(case, choose_friction=True).stream_setup(), [log])
    with pytest.raises(
        LogMismatch, match=r"auto needs all samples .*several passes; find it on a part .*; take load out of "
    ):
        both = replace(case, friction=("coulomb", "load"), choose_friction=True)  # type: ignore[arg-type]
        reduce_logs(both.stream_setup(), [log])
    with pytest.raises(LogMismatch, match="the same content as"):
        reduce_logs(case.stream_setup(), [log, log])
    reduced = reduce_logs(case.stream_setup(), [log])
    with pytest.raises(BadOption, match=r"needs the samples.*consistent, log_cholesky, ols, ridge, wls"):
        identify_digest(reduced, "huber")


def test_faults_of_a_log_are_those_of_the_whole(case: Case, make: Callable[..., Path], tmp_path: Path) -> None:
    log = case.read(make("run.npz", samples=4000))
    q, torque = np.array(log.q), np.array(log.torque)
    q[:, 1], torque[:, 0] = 0.3, 2.0
    late = np.where(np.arange(4000) < 2500, log.time, log.time + 2.0)
    huge = np.array(log.torque)
    huge[3100, 1] = 1e9
    bursts = np.arange(4000) // 20 * 0.1 + np.arange(4000) % 20 * 1e-5
    for changes in ({"q": q}, {"torque": torque}, {"time": late}, {"torque": huge}, {"time": bursts}):
        write_log(replace(log, **changes), tmp_path / "bad.npz")  # type: ignore[arg-type]
        same_refusal(case, tmp_path / "bad.npz")
    write_log(log, tmp_path / "sound.npz")
    bare = replace(case, columns=replace(case.columns, torque=(), current=()))
    warm = replace(case, friction=("coulomb", "viscous", "temperature"))  # type: ignore[arg-type]
    assert "no torques" in same_refusal(bare, tmp_path / "sound.npz")
    assert "no temperatures of the drives" in same_refusal(warm, tmp_path / "sound.npz")


def test_spells_that_are_left_out(case: Case, make: Callable[..., Path]) -> None:
    logs = [make("run.npz", jitter=0.3), make("other.npz", seed=1)]
    columns = replace(case.columns, leave_out=(("run.npz", ((5.0, 20.0), (40.0, 44.0))),))
    spared = replace(case, columns=columns)
    wanted = in_memory(spared, logs, "wls")
    assert_same(identify_digest(reduce_logs(spared.stream_setup(), logs), "wls"), wanted)
    whole = in_memory(case, logs, "wls")
    assert 2 * 19 * 99 < wanted.provenance["logs"][0]["gap_samples"] < 2 * 22 * 100
    assert whole.provenance["logs"][1] == wanted.provenance["logs"][1]
    assert "5 to 20 s left out" in wanted.provenance["logs"][0]["steps"]


@pytest.mark.parametrize("held", [("q", "torque"), ("q",)])
def test_readings_that_stand_in_several_rows_are_refused(
    held: tuple[str, ...], case: Case, make: Callable[..., Path], tmp_path: Path
) -> None:
    """A stream would filter the steps: 11 % of the torque for 0.8 % of a log in memory (UR10, 10 rows a reading)."""
    log = case.read(make("run.npz", samples=4000))
    rows = np.arange(4000) // 10 * 10
    write_log(replace(log, **{name: getattr(log, name)[rows] for name in held}), tmp_path / "held.npz")
    with pytest.raises(LogMismatch, match=r"stands in 10 rows.*write one row of each reading"):
        reduce_logs(case.stream_setup(), [tmp_path / "held.npz"])


def same_refusal(case: Case, path: Path) -> str:
    """Return the refusal of a log in memory once its stream is refused in the same words."""
    with pytest.raises(LogMismatch) as whole:
        in_memory(case, [path], "wls")
    with pytest.raises(LogMismatch) as caught:
        reduce_logs(case.stream_setup(), [path])
    assert str(caught.value) == str(whole.value)
    return str(whole.value)


def test_a_rate_that_changes_on_the_way_is_refused(
    case: Case, make: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The median step of such a log cannot be held in little memory, and is not guessed."""
    monkeypatch.setattr("dynident.identification.streaming.time_scan._DISTINCT", 64)
    monkeypatch.setattr(LogStream.times, "__defaults__", (200,))
    log = case.read(make("run.npz", samples=4000))
    generator = np.random.default_rng(0)
    steps = np.where(np.arange(4000) < 400, 0.001, 0.01) * generator.uniform(0.9, 1.1, 4000)
    write_log(replace(log, time=np.cumsum(steps)), tmp_path / "bad.npz")
    with pytest.raises(LogMismatch, match="its rate changes on the way, or it has many gaps; split it where"):
        reduce_logs(case.stream_setup(), [tmp_path / "bad.npz"])
    with pytest.raises(LogMismatch, match="no log; give at least one log"):
        reduce_logs(case.stream_setup(), [])


@pytest.mark.parametrize("count", [1, 2, 999, 30_000])
def test_the_streamed_median_is_the_median(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dynident.identification.streaming.time_scan._DISTINCT", 512)
    values = np.random.default_rng(count).gamma(2.0, size=count)
    median = StreamedMedian()
    for part in np.array_split(values, 13):
        median.add(part)
    assert median.value() == np.median(values)


def test_a_median_that_was_lost_is_not_guessed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dynident.identification.streaming.time_scan._DISTINCT", 64)
    median = StreamedMedian()
    median.add(np.random.default_rng(0).uniform(0, 1, 500))
    median.add(np.random.default_rng(1).uniform(5, 6, 5000))
    assert np.isnan(median.value())
