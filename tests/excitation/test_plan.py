"""Plans: what is written is what is read, damaged files are named, and a breach refuses every file."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BSpline as Curve

from dynident.data.formats import ColumnMap, read_log
from dynident.errors import BadOption, FileError
from dynident.excitation.design.limits import LimitRow, MotionLimits, check_limits
from dynident.excitation.design.parametrisation import parametrise
from dynident.excitation.design.plan import (
    VERSIONS,
    Plan,
    plan_data,
    read_plan,
    sampled,
    slow_joints,
    write_plan,
    write_samples,
)
from dynident.excitation.trajectories.base import Designable
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.excitation.trajectories.rest_fourier import RestFourier
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.coulomb import Coulomb
from dynident.model.robot import Robot

NONE = np.full(2, np.inf)


def plan_of(kind: str = "rest_fourier", scale: float = 1.0) -> Plan:
    """Return a plan of a turning and a sliding joint made of values alone, checked against round bounds."""
    generator = np.random.default_rng(3)
    if kind == "rest_fourier":
        motion: Designable = RestFourier.from_free(0.1 * scale * generator.normal(size=(2, 5)), 4.0)
    elif kind == "bspline":
        motion = parametrise(kind, 4.0, 3).trajectory(0.1 * scale * generator.normal(size=(2, 5)))
    else:
        motion = FourierSeries(np.zeros(2), *(0.1 * scale * generator.normal(size=(2, 2, 3))), 4.0)
    run_in = 0.0 if motion.at_rest else 1.0
    limits = MotionLimits(
        ("a", "b"),
        (True, False),
        -np.ones(2),
        np.ones(2),
        3 * np.ones(2),
        20 * np.ones(2),
        NONE,
        NONE,
        np.array([500.0, np.inf]),
    )
    values = {"condition": 12.5, "unit_condition": 3.0, "d_optimal": -np.inf}
    draft = Plan("arm", motion, run_in, "condition", values, limits, (), 2001, {"seed": 4, "noise": [1.0, 2.0]})
    return replace(draft, rows=check_limits(draft.motion(), limits, draft.samples))


def test_a_joint_that_stands_for_a_fit_is_named_with_what_holds_it_back(planar_2r: Robot) -> None:
    """A motion that a fit takes for standstill half of the time: by chance, by a limit of speed, by friction."""
    model = DynamicModel(planar_2r, (Coulomb(),))
    plan = plan_of()
    assert slow_joints(replace(plan, limits=replace(plan.limits, revolute=(True, True))), model) == []
    free = np.zeros((2, 5))
    free[:, 1] = [0.5, 0.005]
    plan = replace(plan, trajectory=RestFourier.from_free(free, 4.0))
    plan = replace(plan, limits=replace(plan.limits, revolute=(True, True)))
    (line,) = slow_joints(plan, model)
    assert line.startswith("b moves at 0.0") and "slower than 0.02; design again with more --starts" in line
    assert line.endswith("in the case") and "lock it, with locked: {b: " in line
    (line,) = slow_joints(replace(plan, limits=replace(plan.limits, velocity=np.array([3.0, 0.03]))), model)
    assert "its speed limit and its range allow no more: lock it" in line
    (line,) = slow_joints(replace(plan, limits=replace(plan.limits, torque=np.array([np.inf, 0.5]))), model)
    assert "by the robot model's masses and friction, and 0.5 are allowed: lock it" in line


@pytest.mark.parametrize("kind", ["rest_fourier", "fourier", "bspline"])
def test_a_plan_is_read_as_it_was_written(kind: str, tmp_path: Path) -> None:
    plan = plan_of(kind)
    write_plan(plan, tmp_path / "plan.json")
    found = read_plan(tmp_path / "plan.json")
    assert plan_data(found) == plan_data(plan)
    time = np.linspace(0, plan.motion(2).duration, 50)
    np.testing.assert_array_equal(found.motion(2).evaluate(time), plan.motion(2).evaluate(time))
    assert type(found.trajectory) is type(plan.trajectory) and found.rows == plan.rows
    assert found.feasible and found.joints == ("a", "b")
    np.testing.assert_array_equal(found.limits.bounds(), plan.limits.bounds())
    np.testing.assert_array_equal(found.limits.torque_rate, [500.0, np.inf])


def test_the_file_is_plain_json_of_format_2(tmp_path: Path) -> None:
    write_plan(plan_of(), tmp_path / "plan.json")
    data = json.loads((tmp_path / "plan.json").read_text())
    assert (data["kind"], data["format"], VERSIONS.current) == ("dynident plan", 3, 3)
    assert data["joints"] == [{"name": "a", "kind": "revolute"}, {"name": "b", "kind": "prismatic"}]
    assert data["values"] == {"condition": 12.5, "unit_condition": 3.0, "d_optimal": None}
    assert data["limits"]["jerk"] == [None, None] and data["limits"]["lower"] == [-1.0, -1.0]
    assert data["limits"]["torque_rate"] == [500.0, None]
    assert set(data["trajectory"]) == {"kind", "period", "offset", "sine", "cosine", "run_in"}


def test_a_spline_is_written_with_what_any_other_program_needs(tmp_path: Path) -> None:
    plan = plan_of("bspline")
    write_plan(plan, tmp_path / "plan.json")
    data = json.loads((tmp_path / "plan.json").read_text())["trajectory"]
    assert set(data) == {"kind", "period", "degree", "knots", "control", "run_in"} and data["kind"] == "bspline"
    curve = Curve(np.array(data["knots"]), np.array(data["control"]).T, data["degree"])
    time = np.linspace(0.0, 3.99, 50)
    np.testing.assert_allclose(curve(time), plan.motion().evaluate(time)[0], atol=1e-12)


def test_clearances_are_rows_of_their_pairs(tmp_path: Path) -> None:
    near = LimitRow("hand | floor", "clearance", "m", 0.06, 0.05, 1.5, 0.9)
    plan = plan_of()
    plan = replace(plan, rows=(*plan.rows, near))
    write_plan(plan, tmp_path / "plan.json")
    assert read_plan(tmp_path / "plan.json").rows[-1] == near
    breach = replace(plan, rows=(*plan.rows, replace(near, value=0.01, used=1.4)))
    with pytest.raises(FileError, match=r"the clearance of hand \| floor would be 0.01 m at 1.5 s, its bound is 0.05"):
        write_plan(breach, tmp_path / "plan.json")


@pytest.mark.parametrize("write", [write_plan, lambda plan, path: write_samples(plan, path, 100.0)])
def test_a_breach_refuses_the_file(write: Callable[[Plan, Path], object], tmp_path: Path) -> None:
    plan = plan_of(scale=8.0)
    assert not plan.feasible
    with pytest.raises(FileError, match=r"not written, because the \w+ of [ab] would be .* its bound is") as caught:
        write(plan, tmp_path / "file")
    assert str(caught.value).endswith("; design the motion again with these limits")
    assert not (tmp_path / "file").exists()


def test_a_file_that_was_changed_by_hand_is_checked_again(tmp_path: Path) -> None:
    write_plan(plan_of(), tmp_path / "plan.json")
    data = json.loads((tmp_path / "plan.json").read_text())
    data["trajectory"]["sine"] = (8.0 * np.array(data["trajectory"]["sine"])).tolist()
    (tmp_path / "plan.json").write_text(json.dumps(data))
    changed = read_plan(tmp_path / "plan.json")
    assert changed.feasible  # so says its table
    with pytest.raises(FileError, match="not written, because"):
        write_samples(changed, tmp_path / "plan.csv", 100.0)


@pytest.mark.parametrize("kind", ["rest_fourier", "fourier", "bspline"])
@pytest.mark.parametrize(("rate", "rows"), [(100.0, 401), (37.0, 149)])
def test_samples_are_those_of_the_motion_and_end_at_rest(kind: str, rate: float, rows: int, tmp_path: Path) -> None:
    plan = plan_of(kind)
    length = plan.motion().duration
    rows = rows if kind != "fourier" else int(np.ceil(length * rate)) + 1
    assert write_samples(plan, tmp_path / "plan.csv", rate) == rows
    assert (tmp_path / "plan.csv").read_text().splitlines()[0] == "t,q1,q2,dq1,dq2,ddq1,ddq2"
    table = np.loadtxt(tmp_path / "plan.csv", delimiter=",", skiprows=1)
    assert table.shape == (rows, 7)
    np.testing.assert_allclose(table[:, 0], np.arange(rows) / rate, rtol=1e-11)
    exact = np.hstack(plan.motion().evaluate(np.minimum(table[:, 0], length)))
    np.testing.assert_allclose(table[:, 1:], exact, rtol=1e-11, atol=1e-10)
    np.testing.assert_allclose(table[[0, -1], 3:], 0.0, atol=1e-9)


def test_samples_are_a_log_that_this_library_reads(tmp_path: Path) -> None:
    plan = plan_of()
    write_samples(plan, tmp_path / "plan.csv", 50.0, repeats=3)
    log = read_log(tmp_path / "plan.csv", ColumnMap(joints=("a", "b"), torque=()))
    time, q, dq, _ = sampled(plan, 50.0, repeats=3)
    assert len(time) == 601
    np.testing.assert_allclose(log.q, q, atol=1e-10)
    assert log.dq is not None
    np.testing.assert_allclose(log.dq, dq, atol=1e-10)


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf, 1e9])
def test_rates_that_cannot_be(rate: float) -> None:
    with pytest.raises(BadOption, match="give samples a second, above 0, for less than 10,000,000 rows"):
        sampled(plan_of(), rate)


def test_fewer_than_one_period() -> None:
    with pytest.raises(BadOption, match="repeats = 0"):
        sampled(plan_of(), 10.0, 0)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\xff\xfe", "not UTF-8 text; give a file that 'dynident excite -o' has written"),
        (b"{", "line 1 is not JSON"),
        (b"[]", "no plan"),
        (b'{"kind": "dynident estimate"}', "no plan"),
        (b'{"kind": "dynident plan", "format": 99}', "a plan of version 99; this dynident reads .*; update dynident"),
        (b'{"kind": "dynident plan", "format": 1}', "a damaged plan \\(KeyError: 'limits'\\); design it again"),
        (b'{"kind": "dynident plan", "format": 2}', "a damaged plan \\(KeyError: 'trajectory'\\); design it again"),
    ],
)
def test_files_that_are_no_plan(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_bytes(content)
    with pytest.raises(FileError, match=message):
        read_plan(tmp_path / "plan.json")


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="there is no such file"):
        read_plan(tmp_path / "plan.json")


def _set(*path: Any, value: Any) -> Callable[[Any], None]:
    def change(data: Any) -> None:
        for key in path[:-1]:
            data = data[key]
        data[path[-1]] = value

    return change


DAMAGE: list[Callable[[Any], None]] = [
    _set("trajectory", "kind", value="spline"),
    _set("trajectory", "period", value=-1.0),
    _set("trajectory", "period", value="long"),
    _set("trajectory", "sine", value=[[0.0, 0.0, 1.0]] * 2),
    _set("trajectory", "sine", value=[[0.0, 0.0]]),
    _set("trajectory", "offset", value=[0.0]),
    _set("trajectory", "run_in", value=-1.0),
    _set("limits", "velocity", value=[1.0, 0.0]),
    _set("limits", "upper", value=[1.0]),
    _set("joints", 0, "kind", value="ball"),
    _set("limits", "torque_rate", value=[0.0, None]),
    _set("trajectory", "kind", value="bspline"),
    _set("trajectory", "kind", value="quintic"),
    _set("check", "rows", 0, "quantity", value="clearance"),
    _set("check", "rows", 0, "joint", value="c"),
    _set("check", "rows", 0, value={}),
    _set("check", "samples", value=None),
    _set("values", value=[1.0]),
]


@pytest.mark.parametrize("number", range(len(DAMAGE)))
def test_damage_is_named(number: int, tmp_path: Path) -> None:
    data = plan_data(plan_of())
    DAMAGE[number](data)
    (tmp_path / "plan.json").write_text(json.dumps(data))
    with pytest.raises(FileError, match=r"plan\.json: a damaged plan \(.*\); design it again"):
        read_plan(tmp_path / "plan.json")
