"""Files that earlier versions have written are read, and mean the same; files of newer versions are refused.

tests/golden_files holds one file of each kind and version, as that version wrote it; those of the current version join
them before it is changed. They are never written anew.
"""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.case.case import read_case
from dynident.case.drives_text import GainLine, case_with_drives
from dynident.errors import DynidentError
from dynident.excitation.design.limits import check_limits
from dynident.excitation.design.multistart import DesignCheckpoint
from dynident.excitation.design.plan import read_plan
from dynident.exports.models.writing.document import read_document
from dynident.file_versions import FileVersions, renamed
from dynident.identification.files.estimate_file import read_estimate, summary
from dynident.identification.files.estimate_versions import SUMMARY_2
from dynident.identification.streaming.estimate import identify_digest
from dynident.identification.streaming.triangle_file import read_digest
from dynident.identification.validate import validate
from dynident.model.friction import Motion
from dynident.robot_files import read_robot
from dynident.studies.benchmark.real_sets import read_scoreboard
from dynident.studies.benchmark.runner import Records
from dynident.studies.comparison.truth import read_truth

GOLDEN = Path(__file__).parent / "golden_files"
ESTIMATES = sorted(GOLDEN.glob("estimate-*.json"))


def numbers_in(value: Any) -> Iterator[float]:
    """Yield all numbers of a document, whatever its keys are called; what is null or endless counts as -1."""
    if isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from numbers_in(item)
    elif not isinstance(value, str):
        yield -1.0 if value is None else float(value)


def test_a_case_means_the_same() -> None:
    case = read_case(GOLDEN / "case-1.yaml")
    drives = [joint.drive for joint in case.robot.active]
    assert [(drive.gain, drive.gain_deviation) for drive in drives] == [(10, 0.02), (8, 0.03)]
    assert case.split is not None and (case.split.train, case.split.test) == ((0, 320), (360, 500))
    assert [type(part).__name__ for part in case.friction] == ["Coulomb", "Viscous", "Offset"]
    how = case.preprocessing
    assert (how.filter.cutoff_hz, how.rate_hz, how.trim_s, how.delay_s) == (4.0, 25.0, 0.4, 0.0)  # type: ignore[attr-defined]
    assert (case.columns.time, case.columns.current) == ("t", ("i1", "i2"))
    assert (case.estimator.name, case.train, case.test) == ("wls", ("run.csv",), ())
    assert (case.constraints.total_mass.high, case.constraints.links["upper"].mass.low) == (20, 5)
    assert case.workspace is not None and case.workspace.joint_radius == 0.05


@pytest.mark.parametrize("path", ESTIMATES, ids=lambda path: path.stem)
def test_an_estimate_means_the_same(path: Path) -> None:
    """All numbers of the summary come back, those that are computed again as well; bands are those of kept rows.

    Ranges of parameters and errors of the fastest samples, which these files do not have, are null.
    """
    written, read = json.loads(path.read_text()), read_estimate(path)
    now = summary(read)
    del written["summary"]["train"]["bands"], now["train"]["bands"]
    assert all(each.pop("range") is None for each in now["standard_parameters"] or ())
    assert all(each.pop("fastest") is None for each in now["extras"].get("chosen_fields") or ())
    np.testing.assert_array_equal(read.beta, written["beta"])
    np.testing.assert_array_equal(read.covariance, written["covariance"])
    assert list(read.base.names) == [each["name"] for each in written["summary"]["parameters"]]
    np.testing.assert_array_equal(read.train.measured, written["train"]["signals"]["measured"])
    there, here = sorted(numbers_in(written["summary"])), sorted(numbers_in(now))
    np.testing.assert_allclose(here, there, rtol=1e-7, atol=1e-12)


def test_an_estimate_judges_a_log_as_it_did() -> None:
    """The figures are those that the version of the file printed for the same log."""
    case = read_case(GOLDEN / "case-1.yaml")
    found = validate(read_estimate(GOLDEN / "estimate-1-wls.json"), [case.read("run.csv")])
    told = json.loads((GOLDEN / "validate-1.json").read_text())
    assert found.total_relative_error == pytest.approx(told["test"]["total_relative_error"], rel=1e-9)
    assert found.departure is not None
    for ours, theirs in ((found.figures(), told["test"]), (found.departure.figures(), told["extrapolation"])):
        values = sorted(numbers_in(theirs))
        np.testing.assert_allclose(sorted(numbers_in(ours)), values, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ["plan-1.json", "plan-2.json"])
def test_a_plan_means_the_same(name: str) -> None:
    """The motion has the extremes that the version of the file has found in it."""
    written, plan = json.loads((GOLDEN / name).read_text()), read_plan(GOLDEN / name)
    assert plan.feasible and plan.values["condition"] == written["values"]["condition"]
    bounds = plan.limits.torque_rate
    assert np.isinf(bounds).all()
    again = {(row.joint, row.quantity): row for row in check_limits(plan.motion(), plan.limits, plan.samples)}
    stated = [row for row in written["check"]["rows"] if (row["joint"], row["quantity"]) in again]
    assert len(stated) == 8
    for row in stated:
        own = again[row["joint"], row["quantity"]]
        assert (own.value, own.used) == pytest.approx((row["value"], row["used"]), rel=1e-9)


def test_a_file_of_reduced_logs_means_the_same() -> None:
    """The estimate from it is the one that the version of the file made of it."""
    digest, told = read_digest(GOLDEN / "qr_factors-1.tri"), read_estimate(GOLDEN / "estimate-1-streamed.json")
    found = identify_digest(digest, "wls")
    np.testing.assert_allclose(found.beta, told.beta, rtol=1e-9)
    np.testing.assert_allclose(found.covariance, told.covariance, rtol=1e-7, atol=1e-12)
    assert [(chunk.path, chunk.rows) for chunk in digest.chunks] == [("run.csv", 500)]


def test_the_truth_of_a_log_and_an_exported_model_mean_the_same() -> None:
    case = read_case(GOLDEN / "case-1.yaml")
    truth = read_truth(GOLDEN / "truth-1.json", case.model)
    stated = json.loads((GOLDEN / "truth-1.json").read_text())["parameters"]
    assert dict(zip([p.name for p in case.model.parameters], truth.tolist(), strict=True)) == {
        f"{each['symbol']}[{each['owner']}]": each["value"] for each in stated
    }
    model, values, standard = read_document(GOLDEN / "model-1.json")
    estimate = read_estimate(GOLDEN / "estimate-1-consistent.json")
    assert standard and estimate.theta is not None
    state = Motion(*np.random.default_rng(0).normal(size=(3, 5, 2)))
    np.testing.assert_allclose(model.torque(state, values), estimate.model.torque(state, estimate.theta), rtol=1e-12)


def test_robots_and_searches_mean_the_same() -> None:
    ours, theirs = read_robot(GOLDEN / "robot-1.json"), read_case(GOLDEN / "case-1.yaml").robot
    assert [joint.drive for joint in ours.joints] == [joint.drive for joint in theirs.joints]
    np.testing.assert_array_equal(ours.nominal, theirs.nominal)
    assert read_robot(GOLDEN / "robot-1.yaml").joints[0].drive.gain_deviation == 0.02
    written = json.loads((GOLDEN / "search-1.json").read_text())
    search = DesignCheckpoint(GOLDEN / "search-1.json", written["problem"], 6)
    found = search.read()
    assert sorted(found) == [1, 2]
    free = [one["free"] for one in written["starts"]["1"]["candidates"]]
    np.testing.assert_array_equal([one.free for one in found[1].candidates], free)


def test_a_scoreboard_means_the_same(tmp_path: Path) -> None:
    for name in ("scoreboard.yml", "case-1.yaml", "robot.urdf", "run.csv"):
        (tmp_path / name).write_bytes((GOLDEN / name).read_bytes())
    found = read_scoreboard(tmp_path)
    assert found.sets[0].split is not None and found.sets[0].split.test == (240, 500)
    assert (found.published[0].test_error, found.published[0].training_error) == (0.05, 0.04)


@pytest.mark.parametrize("version", [1, 2])
def test_gains_are_written_into_a_case_of_any_version(version: int, tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_bytes((GOLDEN / "robot.urdf").read_bytes())
    text = (GOLDEN / "case-1.yaml").read_text()
    if version == 2:
        text = text.replace("case: 1", "case: 2").replace("gain_deviation", "gain_std")
    case, place = read_case(GOLDEN / "case-1.yaml"), tmp_path / "new.yaml"
    place.write_text(case_with_drives("case.yaml", text.encode(), case.robot, {"elbow": GainLine(9.0, 0.01, "")}))
    drives = [joint.drive for joint in read_case(place).robot.active]
    assert [(drive.gain, drive.gain_deviation) for drive in drives] == [(10, 0.02), (9, 0.01)]


@pytest.mark.parametrize(("version", "extra"), [(2, ""), (1, "    gain_std: 0.03\n")])
def test_the_old_key_of_a_gain_is_refused_in_a_new_case_and_beside_the_new_key(
    version: int, extra: str, folder: Path
) -> None:
    text = (GOLDEN / "case-1.yaml").read_text().replace("case: 1", f"case: {version}")
    (folder / "case.yaml").write_text(text.replace("    gain_deviation: 0.03\n", f"    gain_deviation: 0.03\n{extra}"))
    with pytest.raises(DynidentError, match=r"unknown key 'gain_deviation'; .* did you mean 'gain_std'"):
        read_case(folder / "case.yaml")


def test_a_table_of_joints_takes_either_key_of_a_gain(tmp_path: Path) -> None:
    text = (GOLDEN / "robot-1.yaml").read_text()
    (tmp_path / "robot.yaml").write_text(text.replace("gain_deviation", "gain_std"))
    assert read_robot(tmp_path / "robot.yaml").joints[0].drive.gain_deviation == 0.02


@dataclass(frozen=True)
class Work:
    """A task of a benchmark."""

    label: str
    facts: Mapping[str, Any]


def test_results_of_a_benchmark_mean_the_same(tmp_path: Path) -> None:
    """The record is one of version 1, with the figures of one joint."""
    records, task = Records(tmp_path), Work("arm: wls", {"robot": "arm"})
    records.write(task, {})
    (place,) = tmp_path.iterdir()
    result = {"held_out_error": 0.1, "joints": [{"name": "a", "rows": 5}]}
    old = {"facts": task.facts, "format": 1, "kind": "dynident benchmark record", "result": result}
    place.write_text(json.dumps(old))
    assert records.read(task) == {"test_error": 0.1, "joints": [{"name": "a", "samples": 5}]}
    place.write_text(json.dumps({**old, "format": 99}))
    assert records.read(task) is None


def test_the_documentation_lists_what_was_renamed() -> None:
    page = (Path(__file__).resolve().parent.parent / "docs" / "json-output.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| [^|]+ \| `([^`]+)` \| `([^`]+)` \|$", page.partition("<!-- renamed keys -->")[2], re.MULTILINE
    )
    listed = {(old.removesuffix("[]"), new.removesuffix("[]").rpartition(".")[2]) for old, new in rows}
    assert len(rows) > 40 and set(SUMMARY_2.items()) <= listed


# --- newer versions, and none -----------------------------------------------------------------------------------------

READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "case-1.yaml": ("case: 1", read_case),
    "estimate-1-wls.json": ('"format": 1', read_estimate),
    "plan-2.json": ('"format": 2', read_plan),
    "robot-1.json": ('"version": 1', read_robot),
    "model-1.json": ('"format": 1', read_document),
    "truth-1.json": ('"format": 1', lambda path: read_truth(path, read_case(GOLDEN / "case-1.yaml").model)),
    "search-1.json": ('"format": 1', lambda path: DesignCheckpoint(path, {}, 6).read()),
    "scoreboard.yml": ("scoreboard: 1", lambda path: read_scoreboard(path.parent)),
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("robot.urdf", "run.csv"):
        (tmp_path / name).write_bytes((GOLDEN / name).read_bytes())
    return tmp_path


@pytest.mark.parametrize("name", READERS)
def test_a_file_of_a_newer_version_is_refused(name: str, folder: Path) -> None:
    mark, read = READERS[name]
    text = (GOLDEN / name).read_text()
    assert mark in text
    (folder / name).write_text(text.replace(mark, f"{mark.rpartition(' ')[0]} 99", 1))
    with pytest.raises(DynidentError, match=r"of version 99; .* update dynident") as caught:
        read(folder / name)
    assert name in str(caught.value)


def with_about(change: Callable[[dict[str, Any]], dict[str, Any]], target: Path) -> Path:
    """Write the golden file of reduced logs with another description in it."""
    with zipfile.ZipFile(GOLDEN / "qr_factors-1.tri") as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "about.npy":
                content = io.BytesIO()
                about = json.dumps(change(json.loads(np.load(io.BytesIO(data)).tobytes()))).encode()
                np.save(content, np.frombuffer(about, dtype=np.uint8))
                data = content.getvalue()
            new.writestr(name, data)
    return target


def test_a_file_of_reduced_logs_of_a_newer_version_is_refused(tmp_path: Path) -> None:
    newer = with_about(lambda about: {**about, "format": 99}, tmp_path / "newer.tri")
    with pytest.raises(DynidentError, match=r"newer\.tri: .* of version 99; .* update dynident"):
        read_digest(newer)


@pytest.mark.parametrize("name", ["case-1.yaml", "estimate-1-wls.json", "truth-1.json", "robot-1.json"])
def test_a_file_without_a_version_is_of_the_oldest(name: str, folder: Path) -> None:
    mark, read = READERS[name]
    text = (GOLDEN / name).read_text()
    (folder / name).write_text(text.replace(f"{mark},", "", 1) if name.endswith(".json") else text.replace(mark, ""))
    read(folder / name)


@pytest.mark.parametrize("version", ["0", "-1", "1.5", "true", '"x"', "99999999999999999999", "[]"])
def test_a_version_that_cannot_be_is_refused(version: str, folder: Path) -> None:
    text = (GOLDEN / "estimate-1-wls.json").read_text()
    (folder / "e.json").write_text(text.replace('"format": 1', f'"format": {version}', 1))
    with pytest.raises(DynidentError, match="version"):
        read_estimate(folder / "e.json")


def test_migrations_follow_one_another() -> None:
    def refuse(evidence: str, step: str) -> DynidentError:
        return DynidentError(f"{evidence}; {step}")

    kind = FileVersions("a thing", (lambda d: {**d, "two": d["one"]}, lambda d: {**d, "three": d["two"]}))
    assert kind.current == 3
    assert kind.migrated({"one": 5}, refuse) == {"one": 5, "two": 5, "three": 5, "format": 3}
    assert kind.migrated({"format": 2, "two": 5}, refuse) == {"two": 5, "three": 5, "format": 3}
    assert kind.migrated({"format": 3}, refuse) == {"format": 3}
    with pytest.raises(DynidentError, match="a thing of version 4; this dynident reads versions up to 3; update"):
        kind.migrated({"format": 4}, refuse)


def test_keys_are_renamed_where_they_are() -> None:
    data = {"a": {"old": 1, "b": [{"old": 2}, {"c": 3}]}, "d": {"x": {"old": 4}, "y": {"old": 5}}, "old": 6}
    found = renamed(data, {"a.old": "new", "a.b[].old": "new", "d.*.old": "new", "missing.old": "new"})
    assert found == {"a": {"new": 1, "b": [{"new": 2}, {"c": 3}]}, "d": {"x": {"new": 4}, "y": {"new": 5}}, "old": 6}
    assert data["a"] == {"old": 1, "b": [{"old": 2}, {"c": 3}]}
    assert renamed({"a": {"old": 1, "new": 2}}, {"a.old": "new"}) == {"a": {"old": 1, "new": 2}}
    assert renamed({"a": 1, "b": "text"}, {"a.old": "new", "b[].old": "new"}) == {"a": 1, "b": "text"}
