"""The estimate file: what was written comes back, what is damaged is refused, and nothing is half written."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.arrays import plain
from dynident.data.formats import ColumnMap, Units
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.errors import EstimateFormatError, FileError
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation
from dynident.identification.files import estimate_file
from dynident.identification.files.estimate_file import read_estimate, summary, write_estimate
from dynident.identification.identify import identify
from dynident.identification.validate import validate
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.robot import Robot

HOW = Preprocessing(Butterworth(cutoff_hz=6.0), rate_hz=25.0, trim_s=0.5, standstill=0.02)


@pytest.fixture(scope="module")
def log(spatial_3r: Robot, exact_log: Callable[..., Log]) -> Log:
    model = DynamicModel(spatial_3r, (Coulomb(0.05), Viscous()))
    assert spatial_3r.nominal is not None
    theta = np.append(spatial_3r.nominal, np.tile([1.0, 0.5], 3))
    return replace(exact_log(model, theta, noise=0.5, samples=1000), dq=None, ddq=None)


@pytest.fixture(scope="module")
def estimate(spatial_3r: Robot, log: Log) -> Estimate:
    model = DynamicModel(spatial_3r, (Coulomb(0.05), Viscous()))
    columns = ColumnMap(
        joints=spatial_3r.joint_names, time="time [s]", q=("a", "b", "c"), units=Units(position=("rad", "deg", "rad"))
    )
    estimate = identify(model, [log, log], "consistent", HOW)
    provenance = {**estimate.provenance, "command": "dynident identify case.yaml"}
    return replace(estimate, columns=columns, provenance=provenance)


@pytest.fixture(scope="module")
def written(estimate: Estimate, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("estimates") / "estimate.json"
    write_estimate(estimate, path)
    return path


def test_everything_comes_back(estimate: Estimate, written: Path) -> None:
    read = read_estimate(written)
    assert read.model.friction == estimate.model.friction
    assert read.model.robot.joint_names == estimate.model.robot.joint_names
    for name in ("beta", "covariance", "theta", "joint_deviations", "correlation_factors"):
        np.testing.assert_array_equal(getattr(read, name), getattr(estimate, name))
    same = ("condition_number", "samples", "inertial_base_parameters", "estimator", "consistency", "preprocessing")
    for name in (*same, "columns"):
        assert getattr(read, name) == getattr(estimate, name), name
    assert dict(read.options) == dict(estimate.options)
    assert read.base.names == estimate.base.names
    assert read.provenance == plain(estimate.provenance)
    assert read.train.joints == estimate.train.joints and read.train.moving == estimate.train.moving
    assert (read.train.logs, read.train.samples) == (estimate.train.logs, estimate.train.samples)
    assert summary(read) == summary(estimate)


def test_signals_come_back_to_seven_digits(estimate: Estimate, written: Path) -> None:
    read = read_estimate(written).train
    assert len(read.time) == estimate.train.samples  # fewer rows than are kept at most
    np.testing.assert_allclose(read.measured, estimate.train.measured, rtol=1e-6)
    assert read.starts == estimate.train.starts


def test_stamps_of_the_system_clock_come_back(estimate: Estimate, tmp_path: Path) -> None:
    """Seconds since 1970, as ROS writes them: seven digits are days."""
    late = replace(estimate, train=replace(estimate.train, time=1.7e9 + estimate.train.time))
    write_estimate(late, tmp_path / "late.json")
    np.testing.assert_allclose(read_estimate(tmp_path / "late.json").train.time - 1.7e9, estimate.train.time, atol=1e-5)


def test_deviations_of_torques_and_standard_parameters_come_back(estimate: Estimate, tmp_path: Path) -> None:
    spread = np.abs(np.random.default_rng(0).normal(size=estimate.train.measured.shape))
    known = replace(estimate.train, deviations=spread, noise=estimate.joint_deviations)
    theirs = np.linspace(0.1, 2.0, len(estimate.model.parameters))
    write_estimate(replace(estimate, train=known, standard_deviations=theirs), tmp_path / "e.json")
    read = read_estimate(tmp_path / "e.json")
    np.testing.assert_array_equal(np.asarray(read.standard_deviations), theirs)
    np.testing.assert_allclose(np.asarray(read.train.deviations), spread, rtol=1e-6)
    assert len(read.train.bands()) == estimate.model.robot.dof and not estimate.train.bands()


def test_an_estimate_that_was_read_predicts_the_same(estimate: Estimate, written: Path, log: Log) -> None:
    ours, read = validate(estimate, [log]), validate(read_estimate(written), [log])
    np.testing.assert_array_equal(read.predicted, ours.predicted)
    assert read.joints == ours.joints


def test_written_twice_is_the_same_text(written: Path, tmp_path: Path) -> None:
    """But for the signals, whose digits are cut once, nothing changes on a second round."""
    again = tmp_path / "again.json"
    write_estimate(read_estimate(written), again)
    assert json.loads(again.read_text()) == json.loads(written.read_text())


def test_long_signals_are_thinned_and_figures_are_not(
    estimate: Estimate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimate_file, "KEPT_ROWS", 50)
    write_estimate(estimate, tmp_path / "e.json")
    read = read_estimate(tmp_path / "e.json")
    assert len(read.train.time) == 50 and read.train.samples == estimate.train.samples
    assert read.train.joints == estimate.train.joints
    first, second = read.train.starts
    assert first == 0 and read.train.time[second] < read.train.time[second - 1]


def test_summary_is_what_the_documentation_lists(estimate: Estimate, log: Log) -> None:
    data = summary(estimate, validate(estimate, [log]))
    assert json.loads(json.dumps(data, allow_nan=False)) == data
    wanted = {"robot", "estimator", "samples", "condition_number", "inertial_base_parameters", "parameters",
              "physically_consistent", "train", "test", "filter"}  # fmt: skip
    assert wanted <= set(data)
    assert set(data["parameters"][0]) == {"name", "value", "unit", "std", "relative_std"}
    assert {"kind", "cutoff_hz", "order", "torque"} <= set(data["filter"])
    for part in ("train", "test"):
        assert {"total_relative_error", "joints"} <= set(data[part])
        figures = {"name", "rmse", "rmse_unfiltered", "correlation", "r2", "relative_error"}
        assert figures <= set(data[part]["joints"][0])
    standard = data["standard_parameters"]
    assert [entry["name"] for entry in standard[:2]] == ["Ixx[link1]", "Ixy[link1]"]
    assert {entry["verdict"] for entry in standard} <= {"identifiable", "only in combination", "not identifiable"}
    assert summary(estimate)["test"] is None


def test_figures_that_do_not_exist_are_null_in_the_file_and_come_back(estimate: Estimate, tmp_path: Path) -> None:
    nothing = replace(estimate.train.joints[0], samples=0, rmse=float("nan"), correlation=float("nan"))
    train: Validation = replace(estimate.train, moving=(nothing, *estimate.train.moving[1:]))
    odd = replace(estimate, train=train, condition_number=float("inf"), theta=None)
    write_estimate(odd, tmp_path / "e.json")
    json.loads((tmp_path / "e.json").read_text(), parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    read = read_estimate(tmp_path / "e.json")
    assert np.isnan(read.train.moving[0].rmse) and read.train.moving[0].samples == 0
    assert read.condition_number == float("inf") and read.theta is None


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "line 1 is not JSON (Expecting value); give a file that 'dynident identify -o' has written"),
        (b"\xff\xfe\x00", "not UTF-8 text; give a file that 'dynident identify -o' has written"),
        (b"t,q1,tau1\n0,0,0\n", "line 1 is not JSON (Expecting value); give a file that 'dynident identify -o' has"),
        (b"[1, 2]", "no estimate; give a file that 'dynident identify -o' has written"),
        (b'{"kind": "something"}', "no estimate; give a file that 'dynident identify -o' has written"),
        (b'{"kind": "dynident estimate"}', "damaged (KeyError: 'friction'); identify again"),
        (b'{"kind": "dynident estimate", "format": 99}', "an estimate of version 99; this dynident reads versions up"),
        (b'{"kind": "dynident estimate", "format": null}', "damaged (KeyError: 'friction'); identify again"),
        (b'{"kind": "dynident estimate", "format": "one"}', "format 'one' is no version; write "),
        (b"[" * 100_000, "no JSON that can be read"),
        (b"1" * 5000, "no JSON that can be read"),
        (b'{"kind": "dynident estimate", "format": 1}', "damaged (KeyError: 'friction'); identify again"),
    ],
)
def test_files_that_are_no_estimate(content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "e.json"
    path.write_bytes(content)
    with pytest.raises(EstimateFormatError) as caught:
        read_estimate(path)
    assert str(caught.value).startswith(f"{path}: {message}")


def test_a_cut_file_is_refused(written: Path, tmp_path: Path) -> None:
    whole = written.read_text()
    for share in (0.1, 0.5, 0.99):
        (tmp_path / "cut.json").write_text(whole[: int(share * len(whole))])
        with pytest.raises(EstimateFormatError, match="is not JSON"):
            read_estimate(tmp_path / "cut.json")


def damaged(data: Any, keys: tuple[Any, ...], value: object) -> dict[str, Any]:
    """Return a deep copy with one entry replaced, or removed where the value is ``...``."""
    copy = json.loads(json.dumps(data))
    inner = copy
    for key in keys[:-1]:
        inner = inner[key]
    if value is ...:
        del inner[keys[-1]]
    else:
        inner[keys[-1]] = value
    return copy


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        *[((key,), ...) for key in ("robot", "friction", "preprocessing", "columns", "beta", "covariance", "theta")],
        *[((key,), ...) for key in ("train", "summary", "provenance")],
        (("beta",), [1.0, 2.0]),
        (("beta",), ["one"]),
        (("beta",), None),
        (("covariance", 0, 0), float("nan")),
        (("covariance",), [[1.0]]),
        (("friction",), [{"coulom": {}}]),
        (("friction",), [{"coulomb": {"width": -1}}]),
        (("friction",), [{"coulomb": {"widht": 1}}]),
        (("friction",), "coulomb"),
        (("robot", "joints"), []),
        (("robot", "schema"), "other"),
        (("preprocessing", "filter"), {"butterwort": {}}),
        (("preprocessing", "filter"), {}),
        (("preprocessing", "rate_hz"), -1),
        (("preprocessing", "more"), 1),
        (("columns", "units"), {"time": "hours"}),
        (("columns", "joints"), ["a", "a", "a"]),
        (("train", "joints"), [{}]),
        (("train", "signals"), {}),
        (("summary",), []),
        (("theta",), "none"),
        (("theta",), [1.0, 2.0]),
        (("train", "signals", "q"), [[0.0]]),
    ],
)
def test_damage_is_named_and_never_believed(
    keys: tuple[Any, ...], value: object, written: Path, tmp_path: Path
) -> None:
    path = tmp_path / "damaged.json"
    path.write_text(json.dumps(damaged(json.loads(written.read_text()), keys, value)))
    with pytest.raises(EstimateFormatError) as caught:
        read_estimate(path)
    assert str(caught.value).startswith(f"{path}: ") and str(caught.value).endswith("; identify again")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"no\.json: there is no such file; check the path"):
        read_estimate(tmp_path / "no.json")
    with pytest.raises(FileError, match="this is a folder; give a file"):
        read_estimate(tmp_path)


def test_plain_data() -> None:
    value = {1: (np.float64(1.5), np.int64(2), float("nan")), "a": np.array([[1.0, np.inf]]), "b": [None, True, "x"]}
    assert plain(value) == {"1": [1.5, 2, None], "a": [[1.0, None]], "b": [None, True, "x"]}
