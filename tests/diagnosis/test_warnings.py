"""Wrong signs, units and limits are named; a sound estimate has no warning."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from dynident import FILTERS, DynamicModel, FourierSeries, Log, Preprocessing, identify, read_robot, validate
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.diagnosis.verdict import check_lines, errors_in, verdict_of
from dynident.diagnosis.warnings import warnings_of
from dynident.identification.consistency.log_cholesky_fit import BOUNDARY, UNFINISHED
from dynident.identification.problem.choices import Choices, GainUncertainty, NoiseBias
from dynident.identification.problem.method_run import MethodRun
from dynident.model.friction import FRICTION, Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.stribeck import Stribeck
from dynident.model.friction.viscous import Viscous


def recorded(flip: int | None = None, stretch: float = 1.0) -> tuple[DynamicModel, Log]:
    model = DynamicModel(read_robot("generic-scara"), (FRICTION.make("viscous"), FRICTION.make("coulomb")))
    generator = np.random.default_rng(0)
    scale = np.array([0.6, 0.6, 0.02, 0.8])[:, None]
    middle = [0.5 * (j.limits.lower + j.limits.upper) if np.isfinite(j.limits.lower) else 0 for j in model.robot.active]
    sine, cosine = scale * generator.normal(size=(2, 4, 4)) / 2
    motion = FourierSeries(np.array(middle), sine, cosine, 10.0)
    time = np.arange(2000) / 200
    q, dq, ddq = motion.evaluate(time)
    theta = model.nominal()
    assert theta is not None
    theta = np.r_[theta[: model.inertial_count], np.tile([0.5, 1.0], 4)]
    torque = model.torque(Motion(q, dq, ddq), theta)
    torque = torque + 0.01 * np.std(torque, axis=0) * generator.normal(size=q.shape)
    if flip is not None:
        torque[:, flip] *= -1
    return model, Log(model.robot.joint_names, time, stretch * q, dq, ddq, torque)


HOW = Preprocessing(AsGiven(), rest="keep")


def test_a_sound_estimate_has_no_warning() -> None:
    model, log = recorded()
    assert warnings_of(identify(model, [log], preprocessing=HOW)) == ()


@pytest.mark.parametrize(("scale", "is_told"), [(0.5, True), (1.2, False)])
def test_a_robot_model_far_from_the_data_is_told(scale: float, is_told: bool) -> None:
    """All torques half as large, or the model of another size of robot, are a good fit with other masses."""
    model, log = recorded()
    estimate = identify(model, [replace(log, torque=scale * np.asarray(log.torque))], preprocessing=HOW)
    told = [line for line in warnings_of(estimate) if "make sure that it is the model of this robot" in line]
    assert len(told) == is_told and bool(verdict_of(estimate).against) == is_told


@pytest.mark.parametrize(("shares", "is_told"), [((0.1, 0.25), True), ((0.15, 0.15), False), ((0.0, 0.0), False)])
def test_load_friction_by_direction_that_passes_for_mass_is_told(shares: tuple[float, float], is_told: bool) -> None:
    """Fitted as one share, other ones driving and driven at all joints move masses by 7 %, with narrow intervals."""
    robot = read_robot("generic-6r")
    parts = {name: FRICTION.make(name) for name in ("coulomb", "viscous")}
    truth = DynamicModel(robot, (*parts.values(), FRICTION.make("load_directional", {"velocity": 100.0})))
    generator, time = np.random.default_rng(1), np.arange(3000) / 100
    sine, cosine = 0.4 * generator.normal(size=(2, 6, 5)) / np.arange(1, 6)
    q, dq, ddq = FourierSeries(np.zeros(6), sine, cosine, 10.0).evaluate(time)
    nominal = np.asarray(robot.nominal)
    bare = DynamicModel(robot).torque(Motion(q, dq, ddq), nominal)
    theta = np.r_[nominal, np.tile([2.0, 3.0, *shares], 6)]
    torque = truth.torque(Motion(q, dq, ddq, bare), theta)
    torque = torque + 0.01 * np.std(torque, axis=0) * generator.normal(size=q.shape)
    log = Log(robot.joint_names, time, q, dq, ddq, torque)
    model = DynamicModel(robot, (*parts.values(), FRICTION.make("load")))
    told = [line for line in warnings_of(identify(model, [log], preprocessing=HOW)) if line.startswith("load friction")]
    assert len(told) == is_told
    if is_told:
        forth, back = re.findall(r"Fl[+-] (0\.\d+)", told[0])
        assert abs(float(forth) - 0.1) < 0.05 and abs(float(back) - 0.25) < 0.05
        assert "load_directional: {velocity: 100, width: 0.02}" in told[0]


def test_a_search_that_ended_far_from_the_proven_optimum_is_told() -> None:
    model, log = recorded()
    estimate = replace(identify(model, [log], preprocessing=HOW), estimator="log_cholesky")
    ended = [replace(estimate, run=MethodRun(verdict=word, gap=3.0)) for word in (UNFINISHED, BOUNDARY)]
    (text,) = warnings_of(ended[0])
    assert "'log_cholesky' did not converge: it ended at 4 times the objective of the proven optimum" in text
    assert warnings_of(ended[1]) == ()


@pytest.mark.parametrize(("name", "warned"), [("five_point", True), ("butterworth", False)])
def test_a_filter_of_the_torque_alone(name: str, warned: bool) -> None:
    model, log = recorded()
    found = warnings_of(identify(model, [log], preprocessing=Preprocessing(FILTERS.make(name), rest="keep")))
    assert any("not the regressor" in text for text in found) is warned, found


def test_a_torque_of_the_wrong_sign() -> None:
    model, log = recorded(flip=1)
    with pytest.warns(UserWarning, match="not accepted: .*torque sign"):
        found = warnings_of(identify(model, [log], preprocessing=HOW))
    assert any("negative correlation" in text for text in found), found


@pytest.mark.parametrize(("factor", "is_told"), [(1.0, False), (1.01, False), (1.6, True)])
def test_a_test_log_of_another_load_or_robot_is_told(factor: float, is_told: bool) -> None:
    model, log = recorded()
    assert log.torque is not None
    estimate = identify(model, [log], preprocessing=HOW)
    found = warnings_of(estimate, validate(estimate, [replace(log, torque=factor * log.torque)]))
    assert bool(found) is is_told, found
    if is_told:
        assert re.search(
            r"the test residual is \d+ times .*'dynident check CASE LOG --against ESTIMATE' looks", found[0]
        )


@pytest.mark.parametrize(("factor", "is_told"), [(1.0, True), (1.6, False)])
@pytest.mark.parametrize("size", [10.0, 0.5])
def test_a_residual_that_is_constant_is_a_zero_of_sensors_unless_another_joint_changes(
    factor: float, is_told: bool, size: float
) -> None:
    model, log = recorded()
    assert log.torque is not None
    estimate = identify(model, [log], preprocessing=HOW)
    torque = log.torque + size * np.array([0.0, 1.0, 0.0, 0.0]) * estimate.joint_deviations
    torque[:, 0] *= factor
    found = warnings_of(estimate, validate(estimate, [replace(log, torque=torque)]))
    told = [text for text in found if text.startswith("residual mostly constant")]
    assert bool(told) is (is_told and size > 1.0), found
    if told:
        name = model.robot.joint_names[1]
        assert told == [found[0]] and f"({name} " in told[0] and "zero of the torque sensors" in told[0]


def test_samples_near_gaps_are_named() -> None:
    model, log = recorded()
    sound = identify(model, [log], preprocessing=HOW)
    (kept,) = sound.provenance["logs"]
    gapped = replace(sound, provenance={"logs": [{**kept, "path": "run.csv", "gap_samples": 12}]})
    assert warnings_of(gapped) == ("run.csv: 12 samples near gaps in time left out",)


def test_a_consistent_fit_that_is_some_tens_of_per_cent_worse_is_no_fault() -> None:
    """Right cases of real robots leave as much, by friction that the model lacks."""
    model, log = recorded()
    sound = identify(model, [log], preprocessing=HOW)
    worse = replace(sound.run, residual_above_unconstrained=0.32)
    assert warnings_of(replace(sound, run=worse)) == ()


def test_positions_beyond_the_limits() -> None:
    model, log = recorded(stretch=57.3)
    told = pytest.warns(UserWarning, match="not accepted: .*millimetres")  # of the slide
    with told, pytest.warns(UserWarning, match="not accepted: .*degrees"):
        found = warnings_of(identify(model, [log], preprocessing=HOW))
    assert any("limits" in text and "check units" in text for text in found), found


def test_what_the_robot_itself_hides() -> None:
    """A base that is 1e-4 rad off the vertical: first moments of the first link hang on that alone."""
    model, log = recorded()
    tilted = replace(model, robot=model.robot.with_gravity([0.0, 9.81e-4, -9.81]))
    estimate = identify(tilted, [log], preprocessing=HOW)
    (found,) = warnings_of(estimate)
    assert found.startswith(
        f"{len(estimate.base.weak)} of {estimate.base.count} base parameters are nearly unidentifiable"
    )
    assert estimate.base.names[estimate.base.weak[0]] in found


def test_load_friction_beside_a_spring_is_told_at_its_joints_alone() -> None:
    model, log = recorded()
    first, second = model.robot.joint_names[:2]
    for joint, is_told in ((first, True), (second, False)):
        parts = (FRICTION.make("load", {"joints": [first]}), FRICTION.make("spring", {"joints": [joint]}))
        estimate = identify(replace(model, friction=(*model.friction, *parts)), [log], "wls", preprocessing=HOW)
        told = [text for text in warnings_of(estimate) if "without the spring" in text]
        assert [text.partition(":")[0] for text in told] == [f"{first} (spring)"] * is_told


@pytest.mark.parametrize(("number", "count"), [(999.0, 0), (1001.0, 1)])
def test_a_poor_condition_number(number: float, count: int) -> None:
    model, log = recorded()
    estimate = replace(identify(model, [log], preprocessing=HOW), condition_number=number)
    assert len(warnings_of(estimate)) == count


def test_a_joint_that_the_model_does_not_explain() -> None:
    """Torques that run against the model, are worse than a constant, or mostly noise, each in its own words."""
    model, log = recorded()
    estimate = identify(model, [log], "wls", preprocessing=HOW)
    torque, size = np.array(log.torque), np.std(np.asarray(log.torque), axis=0)
    torque[:, 0] = 2.0 * torque[:, 0].mean() - torque[:, 0]
    torque[:, 1] = 0.3 * torque[:, 1]
    torque[:, 3] += 1.5 * size[3] * np.random.default_rng(1).normal(size=len(torque))
    found = warnings_of(estimate, validate(estimate, [replace(log, torque=torque)]))
    against, worse, little = found[-3:]
    assert against == "shoulder: negative correlation of predicted and measured torque: check its sign and column"
    assert worse.startswith(f"{log.joints[1]}: the model is worse than a constant (R2 -")
    assert re.fullmatch(
        rf"{log.joints[3]}: the model explains \d\d % of its torque variance \(R2\): check torque signal and friction",
        little,
    )


def test_doubtful_drive_gains_are_told_with_what_they_move() -> None:
    model, log = recorded()
    estimate = identify(model, [log], "wls", preprocessing=HOW)
    moved = np.zeros(len(estimate.beta))
    moved[:3] = 2.0 * estimate.std[:3]
    several = {"joint1": 0.02, "joint2": 0.05, "joint3": 0.0}
    alike = {"joint1": 0.02, "joint2": 0.0201}
    for relative, span in ((several, "2 to 5 %"), ({"joint1": 0.02}, "2 %"), (alike, "2 %")):
        stated = Choices(gain_std=GainUncertainty(relative, tuple(moved.tolist())))
        (found,) = warnings_of(replace(estimate, choices=stated))
        assert found.startswith(f"drive gains have a relative std of {span}: it shifts 3 of {len(moved)} parameters")


def test_noise_of_the_positions_is_told_in_the_unit_of_each_joint() -> None:
    """The largest of hinges in rad and of slides in m: one is not larger than the other."""
    model, log = recorded()
    estimate = identify(model, [log], "wls", preprocessing=HOW)
    noise = NoiseBias((2e-4, 3e-4, 1e-5, 1e-4), tuple((0.9 * estimate.std).tolist()))
    (text,) = [one for one in warnings_of(replace(estimate, choices=Choices(position_noise=noise))) if "noise" in one]
    names = model.robot.joint_names
    assert f"(std 0.0003 rad of {names[1]} and 1e-05 m of {names[2]})" in text


def test_what_is_found_in_several_logs_is_told_once() -> None:
    def log(path: str, *joints: str) -> dict[str, object]:
        kinds = [("warning", "spikes"), ("error", "torque sign"), ("note", "tilt")]
        same = {"evidence": f"of {path}", "remedy": "mend it"}
        found = [{"severity": grave, "name": name, "joint": joint} | same for grave, name in kinds for joint in joints]
        return {"path": path, "findings": found}

    quality = [log("runs/a.csv", "j1"), log("runs/b.csv", "j1", "j2"), log("runs/c.csv")]
    assert check_lines(quality) == ["a.csv and 1 other log: spikes (j1): of runs/a.csv; mend it"]
    assert [str(one) for one in errors_in(quality)] == [
        "a.csv and 1 other log: torque sign (j1): of runs/a.csv; mend it",
        "b.csv: torque sign (j2): of runs/b.csv; mend it",
    ]
    same_name = [log("x/a.csv", "j1"), log("y/a.csv")]
    assert check_lines(same_name) == ["x/a.csv: spikes (j1): of x/a.csv; mend it"]
    assert check_lines([]) == [] and errors_in([log("a.csv")]) == ()


@pytest.mark.parametrize(("period", "is_told"), [(4.0, True), (60.0, False)])
def test_friction_at_breakaway_is_not_determined_by_short_reversals(period: float, is_told: bool) -> None:
    """Velocity and exponent are found from both motions, the level at speed 0 from the slow one alone."""
    parts = (Coulomb(width=0.003), Viscous())
    true = DynamicModel(read_robot("generic-scara"), (*parts, Stribeck(velocity=0.05, exponent=2.0, width=0.003)))
    time, generator = np.arange(4000) / 100, np.random.default_rng(0)
    phase = 2 * np.pi / period * time[:, None] * [1.0, 2.0, 3.0, 2.0] + [0.0, 1.0, 2.0, 3.0]
    size = np.array([1.0, 0.7, 0.03, 0.7])
    q, speed = size * np.sin(phase), 2 * np.pi / period * np.array([1.0, 2.0, 3.0, 2.0])
    motion = Motion(q, size * speed * np.cos(phase), -size * speed**2 * np.sin(phase))
    theta = true.nominal()
    assert theta is not None
    theta = np.r_[theta[: true.inertial_count], np.tile([1.0, 0.5, 0.6], 4)]
    torque = true.torque(motion, theta)
    log = Log(true.robot.joint_names, time, q, torque=torque + 0.01 * generator.normal(size=q.shape))
    found = (*parts, Stribeck(velocity=0.1, width=0.003, vary=("velocity", "exponent")))
    how = Preprocessing(Butterworth(3.0), trim_s=0.5, standstill=0.001)
    estimate = identify(replace(true, friction=found), [log], preprocessing=how)
    told = [line for line in warnings_of(estimate) if line.startswith("static friction is not determined")]
    assert len(told) == is_told
