"""Triangle files: what is written reads back, merges, and goes on after any interruption; damage is named."""

from __future__ import annotations

import io
import itertools
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.api.matching_digests import check_case, merged_file
from dynident.case.case import Case, read_case
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.errors import FileError, TriangleFileError
from dynident.identification.streaming import windows
from dynident.identification.streaming.digest import Digest
from dynident.identification.streaming.estimate import identify_digest
from dynident.identification.streaming.one_log import Checkpoint
from dynident.identification.streaming.reduction import reduce_logs
from dynident.identification.streaming.triangle_file import read_digest, write_digest
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.robot import Robot


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, planar_2r: Robot, exact_log: Callable[..., Log]) -> Path:
    """A folder with a robot and three logs."""
    place = tmp_path_factory.mktemp("cell")
    (place / "arm.json").write_text(json.dumps(robot_to_dict(planar_2r)))
    how = "preprocessing: {filter: {butterworth: {cutoff_hz: 5}}, rate_hz: 200}"
    (place / "case.yaml").write_text(f"case: 1\nrobot: arm.json\n{how}\n")
    case = read_case(place / "case.yaml")
    theta = np.append(planar_2r.nominal, np.tile([0.5, 0.3, 0.1], 2))  # type: ignore[arg-type]
    for seed, name in enumerate("abc"):
        log = exact_log(case.model, theta, noise=0.2, seed=seed, samples=12_000, rate=200.0)
        write_log(Log(log.joints, log.time, log.q, torque=log.torque), place / f"{name}.npz")
    return place


@pytest.fixture
def case(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Case:
    monkeypatch.setattr(windows, "TILE", 1)
    return read_case(folder / "case.yaml")


@pytest.fixture
def parts(folder: Path, case: Case, tmp_path: Path) -> list[Path]:
    """One triangle file of each log."""
    files = []
    for name in "abc":
        write_digest(reduce_logs(case.stream_setup(), [folder / f"{name}.npz"]), tmp_path / f"{name}.tri")
        files.append(tmp_path / f"{name}.tri")
    return files


def assert_equal(found: Digest, wanted: Digest) -> None:
    """Check that two digests are the same to the last bit."""
    assert found.chunks == wanted.chunks and found.how == wanted.how and found.columns == wanted.columns
    for ours, theirs in zip(found.joints, wanted.joints, strict=True):
        for name in ("columns", "factors", "sums", "counts", "resting", "rested", "products"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    for name in ("count", "low", "high", "mean", "spread", "far", "samples", "accelerations", "positions", "torques"):
        np.testing.assert_array_equal(getattr(found.states, name), getattr(wanted.states, name))
    for name in ("time", "q", "dq", "measured", "unfiltered", "starts"):
        np.testing.assert_array_equal(getattr(found.sampled, name), getattr(wanted.sampled, name))


def test_what_is_written_reads_back_bit_for_bit(folder: Path, case: Case, tmp_path: Path) -> None:
    digest = reduce_logs(case.stream_setup(), [folder / "a.npz"])
    write_digest(digest, tmp_path / "a.tri")
    found = read_digest(tmp_path / "a.tri")
    assert_equal(found, digest)
    assert found.base.names == digest.base.names
    np.testing.assert_array_equal(identify_digest(found, "wls").beta, identify_digest(digest, "wls").beta)
    check_case(found, "a.tri", case.model, case.preprocessing)
    with np.load(tmp_path / "a.tri", allow_pickle=False) as archive:
        about = json.loads(archive["about"].tobytes())
    assert about["kind"] == "dynident QR factors" and about["format"] == 2 and about["joints"] == ["joint1", "joint2"]
    assert about["chunks"][0]["rows"] == 12_000 and len(about["chunks"][0]["sha256"]) == 64


def test_merging_is_the_reduction_of_all_in_any_order(folder: Path, case: Case, parts: list[Path]) -> None:
    whole = identify_digest(reduce_logs(case.stream_setup(), [folder / f"{name}.npz" for name in "abc"]), "consistent")
    for order in itertools.permutations(parts):
        found = identify_digest(merged_file(order), "consistent")
        np.testing.assert_allclose(found.beta, whole.beta, rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(found.covariance, whole.covariance, rtol=1e-5, atol=1e-14)
        assert found.samples == whole.samples
        assert found.train.total_relative_error == pytest.approx(whole.train.total_relative_error, rel=1e-9)


def test_merging_in_steps_is_merging_at_once(parts: list[Path], tmp_path: Path) -> None:
    write_digest(merged_file(parts[:2]), tmp_path / "two.tri")
    steps, once = merged_file([tmp_path / "two.tri", parts[2]]), merged_file(parts)
    np.testing.assert_allclose(identify_digest(steps, "wls").beta, identify_digest(once, "wls").beta, rtol=1e-10)
    with pytest.raises(TriangleFileError, match=r"the log .*a\.npz is in .*two\.tri already.*count twice"):
        merged_file([tmp_path / "two.tri", parts[0]])


def test_other_models_and_preparations_do_not_merge(
    folder: Path, case: Case, parts: list[Path], tmp_path: Path
) -> None:
    others = {
        "another preprocessing (rate_hz 50.0, there 200.0)": replace(
            case, preprocessing=replace(case.preprocessing, rate_hz=50.0)
        ),
        "another friction": replace(case, friction=case.friction[:2]),
        "another robot": replace(case, robot=case.robot.with_gravity([0.0, 0.0, -9.81])),
    }
    for words, other in others.items():
        write_digest(reduce_logs(other.stream_setup(), [folder / "b.npz"]), tmp_path / "other.tri")
        with pytest.raises(TriangleFileError, match=re.escape(words)):
            merged_file([parts[0], tmp_path / "other.tri"])
        with pytest.raises(TriangleFileError, match=re.escape(f"other than the case: {words}")):
            check_case(read_digest(tmp_path / "other.tri"), "other.tri", case.model, case.preprocessing)


def test_what_a_case_leaves_open_is_that_of_the_triangles(case: Case, parts: list[Path]) -> None:
    how, digest = case.preprocessing, read_digest(parts[0])
    check_case(digest, "a.tri", case.model, replace(how, filter=Butterworth(), delay_s=None))
    with pytest.raises(TriangleFileError, match=r"another preprocessing \(cutoff_hz 5\.0, there 6\.0, "):
        check_case(digest, "a.tri", case.model, replace(how, filter=Butterworth(cutoff_hz=6.0), delay_s=None))
    with pytest.raises(TriangleFileError, match=r"another preprocessing \(delay_s None, there 0\.002\)"):
        check_case(digest, "a.tri", case.model, replace(how, delay_s=0.002))
    with pytest.raises(TriangleFileError, match=r"another preprocessing \(kind butterworth, there as_given"):
        check_case(digest, "a.tri", case.model, replace(how, filter=AsGiven()))


class Stopped(Exception):
    """Stands for whatever ends the work."""


def stopping(after: int) -> Callable[[str], None]:
    seen = itertools.count()

    def progress(text: str) -> None:
        if "% of" in text and next(seen) == after:
            raise Stopped

    return progress


@pytest.mark.parametrize("after", [0, 1, 3, 5])
def test_work_that_was_stopped_goes_on_to_the_same_bits(after: int, folder: Path, case: Case, tmp_path: Path) -> None:
    logs = [folder / "a.npz", folder / "b.npz"]
    wanted = reduce_logs(case.stream_setup(), logs)
    checkpoint = Checkpoint(tmp_path / "out.tri", 0.0)
    with pytest.raises(Stopped):
        reduce_logs(case.stream_setup(), logs, stopping(after), checkpoint)
    if after:
        with pytest.raises(TriangleFileError, match="cut short; run the same 'dynident reduce' again"):
            read_digest(checkpoint.file(0 if after < 4 else 1))
    told: list[str] = []
    assert_equal(reduce_logs(case.stream_setup(), logs, told.append, checkpoint), wanted)
    assert sum("% of" in text for text in told) == 8 - after
    checkpoint.remove(2)
    assert not list(tmp_path.iterdir())


def test_a_checkpoint_of_other_work_is_not_used(folder: Path, case: Case, tmp_path: Path) -> None:
    checkpoint = Checkpoint(tmp_path / "out.tri", 0.0)
    with pytest.raises(Stopped):
        reduce_logs(case.stream_setup(), [folder / "a.npz"], stopping(2), checkpoint)
    assert_equal(
        reduce_logs(case.stream_setup(), [folder / "b.npz"], checkpoint=checkpoint),
        reduce_logs(case.stream_setup(), [folder / "b.npz"]),
    )
    checkpoint.file(0).write_bytes(b"something else")
    assert_equal(
        reduce_logs(case.stream_setup(), [folder / "a.npz"], checkpoint=checkpoint),
        reduce_logs(case.stream_setup(), [folder / "a.npz"]),
    )


def altered(path: Path, change: Callable[[dict[str, Any]], None]) -> bytes:
    with np.load(path) as archive:
        arrays = dict(archive)
    about = json.loads(arrays["about"].tobytes())
    arrays["about"] = about
    change(arrays)
    if isinstance(arrays.get("about"), dict):
        arrays["about"] = np.frombuffer(json.dumps(arrays["about"]).encode(), dtype=np.uint8)
    content = io.BytesIO()
    np.savez(content, **arrays)
    return content.getvalue()


DAMAGE: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "another kind": (lambda a: a["about"].update(kind="estimate"), "no file of QR factors"),
    "another format": (lambda a: a["about"].update(format=99), "version 99; this dynident reads versions up to"),
    "another gravity": (lambda a: a["about"]["robot"].update(gravity=[0, 0, -1.0]), "its hash is not that"),
    "no robot model": (lambda a: a.pop("about"), "no file of QR factors"),
    "no number": (lambda a: a["factors_0"].__setitem__((0, 0, 0), np.nan), "factors_0 is no array of finite"),
    "another shape": (lambda a: a.update(sums_1=a["sums_1"][:, 1:]), "sums_1 is no array"),
    "columns that are not there": (lambda a: a["columns_1"].__setitem__(0, 99), "columns_1 are no positions"),
    "a column more than there are": (
        lambda a: a["columns_1"].__setitem__(-1, len(a["about"]["base"])),
        "columns_1 are no positions",
    ),
    "fewer rows than none": (lambda a: a["counts_0"].__setitem__(0, -5), "counts_0 are no numbers of rows"),
    "objects": (lambda a: a.update(factors_0=np.array([{}], dtype=object)), "damaged"),
    "no joints": (lambda a: a["about"].pop("chunks"), "damaged"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_named(name: str, parts: list[Path], tmp_path: Path) -> None:
    change, words = DAMAGE[name]
    (tmp_path / "bad.tri").write_bytes(altered(parts[0], change))
    with pytest.raises(TriangleFileError, match=words) as caught:
        read_digest(tmp_path / "bad.tri")
    assert "bad.tri" in str(caught.value) and "\n" not in str(caught.value)


def test_what_is_no_file_of_triangles(parts: list[Path], tmp_path: Path) -> None:
    for content in (b"", b"text", parts[0].read_bytes()[:5000]):
        (tmp_path / "bad.tri").write_bytes(content)
        with pytest.raises(TriangleFileError, match="no file of QR factors, or a damaged one"):
            read_digest(tmp_path / "bad.tri")
    with pytest.raises(FileError, match="no such file"):
        read_digest(tmp_path / "missing.tri")
