"""A robot and arrays to an estimate in three lines, what an estimate can do, and what wrong calls are told."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest

import dynident as di
from dynident.errors import BadOption
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.joint import Mimic

FRICTION = [0.3, 0.1, 0.2, -0.1]
SHAPES = r"q: shape \(2, 1200\) where \(1200, 2\) is wanted; write q\.T"


@pytest.fixture(scope="session")
def arm(planar_2r: di.Robot, exact_log: Callable[..., di.Log], tmp_path_factory: pytest.TempPathFactory) -> Any:
    """File of a robot, and time, positions and torques of a run."""
    limits = di.JointLimits(-1.5, 1.5)
    planar_2r = replace(planar_2r, joints=tuple(replace(joint, limits=limits) for joint in planar_2r.joints))
    path = tmp_path_factory.mktemp("arm") / "arm.json"
    path.write_text(json.dumps(robot_to_dict(planar_2r)))
    assert planar_2r.nominal is not None
    model = di.DynamicModel(planar_2r, ["viscous", "offset"])
    log = exact_log(model, np.append(planar_2r.nominal, FRICTION), noise=0.1, samples=1200, rate=200.0)
    return str(path), {"time": np.asarray(log.time), "q": np.asarray(log.q), "torque": np.asarray(log.torque)}


@pytest.fixture(scope="session")
def estimate(arm: Any) -> di.Estimate:
    robot, log = arm
    return di.identify(di.DynamicModel(di.read_robot(robot), ["viscous", "offset"]), log)


def _frame(log: dict[str, Any], position: str = "q", torque: str = "torque") -> pandas.DataFrame:
    columns = {f"{name}{k + 1}": log[key][:, k] for name, key in ((position, "q"), (torque, "torque")) for k in (0, 1)}
    return pandas.DataFrame({"time": log["time"], **columns})


@pytest.mark.parametrize("rotor", [0.0, 2.0])
def test_rotor_inertia_is_taken_where_the_log_has_it(rotor: float, arm: Any, exact_log: Callable[..., di.Log]) -> None:
    """An arm with geared drives is not told heavier than it is; without rotors there is no parameter of them."""
    robot = di.read_robot(arm[0])
    assert robot.nominal is not None
    model = di.DynamicModel(robot, ["coulomb", "viscous", "rotor_inertia"])
    theta = np.append(robot.nominal, np.tile([0.4, 0.3, rotor], 2))
    log = exact_log(model, theta, noise=0.1, samples=2400, rate=200.0)
    found = di.identify(arm[0], {"time": log.time, "q": log.q, "torque": log.torque})
    names = [parameter.name for parameter in found.base.parameters]
    assert ("Ia[joint1]" in names) == (rotor > 0)
    assert found.theta is not None
    masses = np.asarray(found.theta)[9:20:10]
    np.testing.assert_allclose(masses, robot.nominal[9:20:10], rtol=0.05)


def test_arrays_frames_and_files_are_the_same_log(arm: Any, tmp_path: Path) -> None:
    robot, arrays = arm
    names = di.read_robot(robot).joint_names
    di.write_log(di.log_of(arrays, robot), tmp_path / "run.csv")
    by_arrays = di.identify(robot, arrays, "wls", trust=di.TrustOptions())
    called = _frame(arrays).rename(columns={f"q{k + 1}": f"q_{name}" for k, name in enumerate(names)})
    lists = {name: values.tolist() for name, values in arrays.items()}
    for given in (tmp_path / "run.csv", _frame(arrays), called, lists, [di.log_of(arrays, robot)]):
        found = di.identify(robot, given, "wls", trust=di.TrustOptions())  # type: ignore[arg-type]
        np.testing.assert_allclose(found.beta, by_arrays.beta, rtol=1e-9)


def test_text_of_an_estimate(estimate: di.Estimate, arm: Any) -> None:
    text = estimate.summary()
    assert max(map(len, text.splitlines())) <= 110
    assert "P>|t|" in text and "training data" in text and "(--accept)" not in text
    rows = {line.split()[0]: line.split() for line in text.splitlines() if line.startswith("Fv[")}
    assert len(rows) == 2
    assert len(repr(estimate)) < 200 and "training error" in repr(estimate)
    for value in (estimate.model, estimate.model.robot, estimate.train, di.log_of(arm[1])):
        assert len(repr(value)) < 200
    page = estimate._repr_html_()
    assert page.startswith("<div>") and page.count("<table>") == 2 and len(page) < 20_000


def test_frame_of_an_estimate(estimate: di.Estimate) -> None:
    frame = estimate.to_frame()
    assert list(frame.index) == list(estimate.base.names)
    np.testing.assert_allclose(frame["upper"] - frame["value"], estimate.half_widths())
    viscous = frame.loc["Fv[joint1]"]
    assert viscous["t"] == pytest.approx(viscous["value"] / viscous["std"]) and viscous["p"] < 1e-3
    inside = (frame["lower"] < 0) & (frame["upper"] > 0)
    np.testing.assert_array_equal(inside, frame["p"] > 0.05)


def test_torques_at_arrays(estimate: di.Estimate) -> None:
    model, base = estimate.model, estimate.base
    theta = base.to_standard(estimate.beta)
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 20, 2))
    regressor = model.regressor(q, dq, ddq)
    assert regressor.shape == (20, 2, len(model.parameters))
    np.testing.assert_allclose(estimate.predict(q, dq, ddq), regressor @ theta, atol=1e-10)
    np.testing.assert_array_equal(model.regressor(q[0], dq[0], ddq[0]), regressor[0])
    np.testing.assert_allclose(model.torque(q, dq, ddq, theta), model.torque(di.Motion(q, dq, ddq), theta))
    still = np.zeros_like(q)
    inertial = estimate.predict(q, still, ddq) - estimate.predict(q, still, still)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", estimate.mass_matrix(q), ddq), inertial, atol=1e-10)
    rest = np.append(theta[: model.inertial_count], np.zeros(len(theta) - model.inertial_count))
    np.testing.assert_allclose(estimate.gravity(q), model.torque(q, theta=rest), atol=1e-10)
    assert model.mass_matrix(q[0]).shape == (2, 2) and model.gravity(q[0]).shape == (2,)


def test_plots(estimate: di.Estimate, arm: Any) -> None:
    figure = estimate.plot_torques(estimate.train, joints=["joint2"])
    drawn = {line.get_label(): line.get_ydata() for line in figure.axes[0].lines}
    np.testing.assert_allclose(drawn["measured"] - drawn["predicted"], drawn["residual"], atol=1e-12)
    assert len(estimate.plot_torques().axes) == 2
    assert len(estimate.plot_parameters().axes[0].get_yticks()) == estimate.base.count
    curve = estimate.plot_friction("joint1").axes[0].lines[1]
    slope = np.polyfit(curve.get_xdata(), curve.get_ydata(), 1)[0]
    assert slope == pytest.approx(estimate.to_frame().loc["Fv[joint1]", "value"], rel=1e-6)
    with pytest.raises(di.BadArgument, match="'wrist' where the robot has joint1, joint2"):
        estimate.plot_torques(joints=["wrist"])
    with pytest.raises(di.BadArgument, match=r"di\.validate\(estimate, log\)"):
        estimate.plot_torques(arm[1])


def test_files_of_an_estimate(estimate: di.Estimate, tmp_path: Path) -> None:
    estimate.save(tmp_path / "e.json")
    again = di.Estimate.load(tmp_path / "e.json")
    np.testing.assert_array_equal(again.beta, estimate.beta)
    done = estimate.export("urdf", tmp_path / "new.urdf")
    q = np.array([0.3, -0.4])
    robot = di.read_robot(str(tmp_path / "new.urdf")).with_gravity(estimate.model.robot.gravity)
    np.testing.assert_allclose(di.DynamicModel(robot).gravity(q), estimate.gravity(q), atol=1e-6)
    assert len(repr(done)) < 400 and "new.urdf" in repr(done)


@pytest.mark.parametrize(("package", "call"), [("matplotlib", "plot_torques"), ("pandas", "to_frame")])
def test_without_the_extra(package: str, call: str, estimate: di.Estimate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(di.DynidentError, match=rf"pip install 'dynident\[{'plot' if call[0] == 'p' else 'pandas'}\]'"):
        getattr(estimate, call)()


WRONG: list[tuple[Callable[[dict[str, Any]], Any], str]] = [
    (lambda log: log | {"q": log["q"].T}, SHAPES),
    (
        lambda log: log | {"q": log["q"][:, :1]},
        r"q: shape \(1200, 1\) where \(1200, 2\) is wanted; give one column for each of the joints \w+, \w+; "
        r"lock those that did not move.*: di\.robot_of\(robot\)\.locked\(\{\"\w+\": 0\.0\}\) as the robot$",
    ),
    (
        lambda log: log | {"q": np.column_stack([log["q"]] * 2)},
        r"q: shape \(1200, 4\) where \(1200, 2\) is wanted; give one column for each of the joints \w+, \w+$",
    ),
    (
        lambda log: log | {"q": np.rad2deg(log["q"])},
        r"whose limit is .* rad; if it is in degrees write q = np\.deg2rad",
    ),
    (
        lambda log: log | {"q": log["q"] + [0.0, -4 * np.pi]},
        r"they are 2 turns off, as np\.unwrap may leave them: write q\[\.\.\., 1\] \+= 4 \* np\.pi; if it is in deg",
    ),
    (lambda log: log | {"q": np.where(log["time"][:, None] > 3, np.nan, log["q"])}, "not finite, first in row 601; "),
    (lambda log: log | {"q": np.ma.masked_greater(log["q"], 0.5)}, r"masked, first in row \d+; keep .*np\.ma\.filled"),
    (lambda log: log | {"q": [*log["q"].tolist()[:-1], [1.0]]}, "q: list that is no array of numbers; give rows"),
    (lambda log: log | {"time": log["time"][::-1]}, r"time: it runs back at row 1 .*; sort the samples: order = np\."),
    (
        lambda log: {name: values.reshape(3, 400, -1) for name, values in log.items()},
        r"q: shape \(3, 400, 2\), several episodes in one array; pass a list of logs, one an episode: "
        r'\[\{"time": time\[k\], "q": q\[k\], "torque": torque\[k\]\} for k in range\(len\(q\)\)\]$',
    ),
    (
        lambda log: log | {"time": np.tile(log["time"][:400], 3)},
        r"time: it runs back at row 400 .*; pass a list of logs, one for each of the 3 recordings: cuts = ",
    ),
    (
        lambda log: log | {"time": np.round(log["time"], 1)},
        r"time: it repeats at row 1 .*; of samples that repeat, leave out the \d{3,} that have it again$",
    ),
    (lambda log: log | {"time": (1e9 * log["time"]).astype("datetime64[ns]")}, r"np\.timedelta64\(1, \"s\"\)"),
    (lambda log: log | {"time": np.stack([log["time"]] * 2)}, r"time: shape \(2, 1200\) where \(N,\) is wanted"),
    (lambda log: {name: log[name] for name in ("time", "q")}, "logs: neither torques nor currents with drive gains"),
    (lambda log: {"t": log["time"], "tau": log["torque"]}, r"log: arrays t, tau, and none is 'q'; write \{\"time\""),
    (lambda log: log | {"torqe": log["torque"]}, "an array 'torqe', where the signals are time, q"),
    (lambda log: tuple(log.values()), r"logs: tuple of numbers where logs are wanted; write \{\"time\": t, \"q\": q"),
    (lambda log: log["q"], r"logs: ndarray of shape \(1200, 2\) of numbers without names"),
    (lambda log: _frame(log, "pos"), r"where 'q1', 'q2', \.\.\. or 'q_joint1', .* frame\.rename\(columns=\{\"pos1\""),
    (lambda log: _frame(log).drop(columns="q2"), r"none is 'q2'; name it: frame\.rename"),
    (lambda log: 5, "logs: int where logs are wanted"),
    (lambda log: "wls", "logs: 'wls', which is an estimator; write estimator=\"wls\""),
]


@pytest.mark.parametrize(("made", "told"), WRONG, ids=[str(k) for k in range(len(WRONG))])
def test_wrong_logs(made: Callable[[dict[str, Any]], Any], told: str, arm: Any) -> None:
    robot, log = arm
    with pytest.raises(di.BadArgument, match=told):
        di.identify(robot, made(log))


def test_the_lines_for_several_episodes_work(arm: Any) -> None:
    """Each line of the messages above gives the logs that were put together."""
    robot, log = arm
    time, q, torque = (values.reshape(3, 400, -1) for values in log.values())
    starts = np.tile(log["time"][:400], 3)
    for given in (
        {"time": time[..., 0], "q": q, "torque": torque},
        {"time": log["time"], "q": q, "torque": torque},
        {"time": log["time"][:400], "q": q, "torque": torque},
        log | {"time": starts},
    ):
        with pytest.raises(di.BadArgument) as told:
            di.identify(robot, given)
        head, _, line = str(told.value).rpartition(", then ") if "cuts" in str(told.value) else ("", "", "")
        names = {"np": np, **given}
        if line:
            exec(head.rpartition("recordings: ")[2], names)
        logs = eval(line or str(told.value).rpartition("an episode: ")[2], names)
        assert [np.shape(each["q"]) for each in logs] == [(400, 2)] * 3
        assert np.array_equal(logs[2]["q"], q[2]) and len(di.log_of(logs[1], robot).time) == 400


def test_a_joint_that_follows_another_is_named_where_it_has_a_column(arm: Any) -> None:
    robot, log = arm
    one, two = (free := di.read_robot(robot)).joints
    tied = replace(free, joints=(one, replace(two, mimic=Mimic(one.name))), coupling=np.eye(1))
    with pytest.raises(di.BadArgument, match=rf"{two.name} follows others: np\.delete\(array, \[1\], axis=1\)$"):
        di.identify(tied, log)


def test_folds_that_make_no_parts_are_refused_before_the_fit(arm: Any) -> None:
    robot, log = arm
    for folds in (3000, 1, -3):
        with pytest.raises(BadOption, match=rf"folds = {folds} is not possible; give 2 to \d+ folds"):
            di.identify(robot, log, trust=di.TrustOptions(diagnose=True, folds=folds))
    assert di.identify(robot, log, "ols", trust=di.TrustOptions(diagnose=True, folds=6)).diagnostics is not None


def test_wrong_options(arm: Any, estimate: di.Estimate) -> None:
    robot, log = arm
    for options, told in (
        ({"preprocessing": "butterworth"}, r"write preprocessing=di\.Preprocessing\(di\.FILTERS\.make"),
        ({"trust": "all"}, r"trust: the text 'all' where a TrustOptions is wanted; write trust=di\.TrustOptions"),
        ({"record": True}, r"write record=di\.Record\(strict=True\)"),
    ):
        with pytest.raises(di.BadArgument, match=told):
            di.identify(robot, log, **options)  # type: ignore[arg-type]
    with pytest.raises(di.BadArgument, match=r'int where a robot is wanted; write di\.identify\("arm\.urdf", log\)'):
        di.identify(3, log)  # type: ignore[arg-type]
    with pytest.raises(di.BadArgument, match=r"di\.read_estimate\(path\)"):
        di.validate("estimate.json", log)  # type: ignore[arg-type]
    for q, told in (
        (np.zeros(3), r"q: shape \(3,\) where \(2,\) or \(N, 2\) is wanted"),
        (np.zeros((2, 5)), r"write q\.T"),
        ([[0.0, np.nan]], "not finite, first in row 0"),
        ([0.0, 90.0], r"np\.deg2rad\(q\)"),
    ):
        with pytest.raises(di.BadArgument, match=told):
            estimate.predict(q)
    with pytest.raises(di.BadArgument, match=r"dq: shape \(3, 2\) where q has \(2,\); give dq like q"):
        estimate.predict(np.zeros(2), np.zeros((3, 2)))
    with pytest.raises(di.BadArgument, match=r"theta: shape \(2,\) where \(24,\) is wanted"):
        estimate.model.torque(np.zeros(2), theta=[1.0, 2.0])


def test_other_verbs_take_files_and_lists(arm: Any, tmp_path: Path) -> None:
    robot, log = arm
    di.write_log(di.log_of(log, robot), tmp_path / "run.csv")
    case = tmp_path / "case.yaml"
    case.write_text(f"case: 2\nrobot: {robot}\nfriction: [viscous, offset]\ntrain: run.csv\nsplit: first:0.6\n")
    listed, written = (list(di.compare(given, ["ols", "wls"])) for given in (str(case), di.read_case(case)))
    assert [one.method for one in listed] == [one.method for one in written] == ["ols", "wls"]
    given = list(di.compare(robot, ["ols", "wls"], di.log_of(log, robot).split(0.6)))
    assert [one.method for one in given] == ["ols", "wls"]
    with pytest.raises(di.BadArgument, match="int where a robot is wanted"):
        list(di.compare(3))  # type: ignore[arg-type]
    with pytest.raises(di.BadArgument, match="list where a robot is wanted"):
        di.excite([robot])  # type: ignore[arg-type]


def test_friction_by_name(arm: Any) -> None:
    robot = di.read_robot(arm[0])
    one, two = di.DynamicModel(robot, "viscous"), di.DynamicModel(robot, ("viscous",))
    assert one == two and one.friction == (di.FRICTION.make("viscous"),)
    assert di.read_case(arm[0], friction="auto").choose_friction
    assert di.read_case(arm[0], friction=["viscous"]).friction == one.friction


def test_what_an_estimate_was_made_from_is_not_overwritten(arm: Any, tmp_path: Path) -> None:
    robot, log = arm
    place, run = tmp_path / "arm.json", tmp_path / "run.csv"
    place.write_text(Path(robot).read_text())
    di.write_log(di.log_of(log, robot), run)
    estimate = di.identify(str(place), str(run), trust=di.TrustOptions())
    before = place.read_bytes(), run.read_bytes()
    for path in (place, run):
        for write in (
            estimate.save,
            lambda path: estimate.export("csv", path),
            lambda path: di.write_report(path, estimate),
        ):
            with pytest.raises(di.DynidentError, match=f"{path.name}: it is an input of this command"):
                write(path)
    assert (place.read_bytes(), run.read_bytes()) == before


def test_an_estimate_without_a_case_file_needs_a_log(estimate: di.Estimate) -> None:
    with pytest.raises(di.BadArgument, match=r"logs: none given, and no case file of the fit .* write di\.validate\("):
        di.validate(estimate)


def test_training_data_are_no_test(arm: Any, estimate: di.Estimate) -> None:
    log = arm[1]
    with pytest.warns(UserWarning, match="arrays: used for training, so the errors are optimistic"):
        di.validate(estimate, log)
    first, rest = di.log_of(log, arm[0]).split(0.7)
    di.validate(di.identify(arm[0], first, "wls", trust=di.TrustOptions()), rest)  # no warning


def test_torques_in_another_unit_are_not_accepted(arm: Any) -> None:
    robot, log = arm
    with pytest.warns(UserWarning, match=r"not accepted: .*torque unit: .*N mm, torque = torque \* 0\.001"):
        estimate = di.identify(robot, {**log, "torque": 1000.0 * log["torque"]}, trust=di.TrustOptions())
    assert ", NOT ACCEPTED, " in repr(estimate)


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (
            lambda robot, log, estimate: di.identify(robot, log, True),
            "estimator: bool where a name or a part is wanted",
        ),
        (lambda robot, log, estimate: estimate.summary(log), "test: dict where a Validation is wanted"),
        (lambda robot, log, estimate: list(di.compare(robot, ["ols"], log)), "data: dict where logs to learn from and"),
        (lambda robot, log, estimate: list(di.compare(robot, ["ols"], (log, 3))), "data: int where logs are wanted"),
        (lambda robot, log, estimate: di.write_report(estimate, "a.html"), "estimate: str where an Estimate is wanted"),
        (lambda robot, log, estimate: estimate.plot_torques(joints=0), "joints: 0 where the robot has"),
        (lambda robot, log, estimate: di.init(robot, log), "logs: dict where a file is wanted"),
        (lambda robot, log, estimate: di.robot_of("<robot/>"), "robot: the text of a robot model where its file"),
        (lambda robot, log, estimate: di.identify(robot, {**log, "q": log["q"] + 0j}), "q: complex numbers"),
    ],
)
def test_wrong_calls_name_the_argument(call: Any, told: str, arm: Any, estimate: di.Estimate) -> None:
    with pytest.raises(di.BadArgument) as caught:
        call(*arm, estimate)
    assert told in str(caught.value)


def test_columns_of_a_frame_that_stand_there_twice_are_named(arm: Any) -> None:
    frame = _frame(arm[1])
    twice = pandas.concat([frame, frame[["q1"]]], axis=1)
    with pytest.raises(di.BadArgument, match="log: the columns q1 stand there twice"):
        di.log_of(twice, arm[0])
