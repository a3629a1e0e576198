"""Gains from two runs: exact data give them exactly, noisy ones within their intervals, open ones are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from loaded_arms import BODY, CENTRE, GIVEN, MASS, LoadedArm

from dynident.applications.drive_gains import METHODS, CarriedBody, DriveGains, GainOptions, gains_from_payload
from dynident.errors import BadOption, LogMismatch, SolverFailed, UnknownChoice
from dynident.model.joint import Drive
from dynident.model.robot import Robot

KNOWN = {"mass": CarriedBody(MASS), "centre": CarriedBody(MASS, CENTRE), "inertia": CarriedBody(MASS, CENTRE, BODY)}


def found(arm: LoadedArm, payload: CarriedBody, noise: float = 0.0, seed: int = 0, **options: object) -> DriveGains:
    logs = [arm.log(False, noise, seed)], [arm.log(True, noise, seed, warm=1.3)]
    return gains_from_payload(arm.model, *logs, payload, GIVEN, options=GainOptions(**options))  # type: ignore[arg-type]


def values(gains: DriveGains) -> np.ndarray:
    return np.array([gain.value for gain in gains.gains])


@pytest.mark.parametrize("known", KNOWN)
@pytest.mark.parametrize("method", METHODS)
def test_exact_currents_give_the_true_gains(spatial_3r: Robot, known: str, method: str) -> None:
    arm = LoadedArm(spatial_3r, np.array([14.0, -9.0, 6.0]))
    gains = found(arm, KNOWN[known], method=method)
    np.testing.assert_allclose(values(gains), arm.gains, rtol=1e-6)
    assert [gain.label for gain in gains.gains] == ["identified", "reversed", "identified"]
    if known == "mass":
        np.testing.assert_allclose(list(gains.found.values()), CENTRE, atol=1e-6)


def test_a_coupled_wrist_with_known_rotors_and_a_bias(coupled_arm: Robot) -> None:
    drives = {joint.name: replace(joint.drive, bias=3.0) for joint in coupled_arm.active}
    arm = LoadedArm(coupled_arm.with_drives(drives), np.array([14.0, 9.0, 6.0]))
    gains = found(arm, CarriedBody(MASS, CENTRE))
    np.testing.assert_allclose(values(gains), arm.gains, rtol=1e-6)
    logs = [arm.log(False)], [arm.log(True)]
    plain = replace(arm.model, robot=arm.robot.with_drives({}, np.eye(arm.robot.dof)))
    wrong = gains_from_payload(plain, *logs, CarriedBody(MASS, CENTRE), GIVEN)
    assert np.max(np.abs(values(wrong) / arm.gains - 1)) > 0.01  # the coupling matters


def test_friction_that_grows_with_the_load(spatial_3r: Robot) -> None:
    arm = LoadedArm(spatial_3r, np.array([14.0, 9.0, 6.0]), ("viscous", "load"))
    logs = [arm.log(False)], [arm.log(True)]
    gains = gains_from_payload(arm.model, *logs, CarriedBody(MASS, CENTRE), GIVEN)
    np.testing.assert_allclose(values(gains), arm.gains, rtol=2e-3)


def test_a_gain_for_each_sign_of_the_current(spatial_3r: Robot) -> None:
    arm = LoadedArm(spatial_3r, np.array([14.0, 9.0, 6.0]))
    logs = []
    for payload in (False, True):
        log = arm.log(payload)
        current = np.asarray(log.current)
        logs.append([replace(log, current=np.where(current > 0, current / 0.9, current))])
    gains = gains_from_payload(arm.model, *logs, CarriedBody(MASS), GIVEN, options=GainOptions(signed=True))
    wanted = np.column_stack([0.9 * arm.gains, arm.gains]).ravel()
    np.testing.assert_allclose(values(gains), wanted, rtol=1e-6)
    assert [gain.name for gain in gains.gains][:2] == ["joint1 (+)", "joint1 (-)"]
    assert gains.by_joint() == {}


def test_a_gain_that_grows_beyond_all_bounds_stops_no_search_for_the_delay(spatial_3r: Robot) -> None:
    """The stated centre is wrong; currents are percent, and a drive of 1e9 N m was called a fault of the recording."""
    arm = replace(LoadedArm(spatial_3r, np.array([0.14, 0.09, 0.06]), ("viscous",)), rate=200.0)
    logs = [arm.log(False, 0.1)], [arm.log(True, 0.1, warm=1.3)]
    payload = CarriedBody(MASS, np.array([-0.3, 0.05, 0.0]))
    gains = gains_from_payload(arm.model, *logs, payload, replace(GIVEN, delay_s=None))
    assert not any(gain.known for gain in gains.gains) and np.max(np.abs(values(gains))) > 1e5
    np.testing.assert_allclose(gains.delays, [0.0, 0.0], atol=1e-3)


def test_a_gain_that_a_first_fit_loses_in_noise_is_found_again(spatial_3r: Robot) -> None:
    """Least squares has that of joint3 far too small, from where it went to -4e-6 with no end of its interval."""
    arm = LoadedArm(spatial_3r, np.array([14.0, 9.0, 6.0]), seconds=6.0)
    for gain, true in zip(found(arm, CarriedBody(MASS), 0.2, 5).gains, arm.gains, strict=True):
        assert gain.low < true < gain.high and gain.value == pytest.approx(true, rel=0.15)


@pytest.mark.parametrize("payload", KNOWN.values(), ids=KNOWN)
def test_a_base_that_leans_is_named_with_its_gravity(spatial_3r: Robot, payload: CarriedBody) -> None:
    """A stated centre that then seems to contradict the logs as well is not what is named."""
    arm = LoadedArm(spatial_3r, np.array([14.0, 9.0, 6.0]))
    tilt = np.radians(12.0)
    stated = 9.81 * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    logs = [arm.log(False, 0.02)], [arm.log(True, 0.02, warm=1.3)]
    wrong = replace(arm.model, robot=spatial_3r.with_gravity(stated))
    gains = gains_from_payload(wrong, *logs, payload, GIVEN)
    assert gains.by_joint() == {}
    (told,) = {gain.reason for gain in gains.gains}
    assert "the stated gravity contradicts the logs" in told
    named = [float(value) for value in told.rpartition("[")[2].partition("]")[0].split(",")]
    np.testing.assert_allclose(named, spatial_3r.gravity, atol=0.1)
    assert gains_from_payload(arm.model, *logs, payload, GIVEN).complete


@pytest.mark.battery
def test_intervals_hold_the_truth_and_weighted_least_squares_is_too_small(spatial_3r: Robot) -> None:
    arm = LoadedArm(spatial_3r, np.array([14.0, 9.0, 6.0]))
    inside, plain = [], []
    for seed in range(20):
        gains = found(arm, CarriedBody(MASS), 0.1, seed)
        inside.append([gain.low <= true <= gain.high for gain, true in zip(gains.gains, arm.gains, strict=True)])
        if seed < 4:
            plain.append(values(found(arm, CarriedBody(MASS), 0.1, seed, method="wls")) / arm.gains)
    assert 0.85 <= np.mean(inside) <= 1.0
    assert np.mean(plain) < 0.97


def test_a_doubtful_mass_makes_all_gains_doubtful_alike(spatial_3r: Robot) -> None:
    arm = LoadedArm(spatial_3r, np.array([14.0, 9.0, 6.0]))
    sure = found(arm, CarriedBody(MASS, CENTRE), 0.02)
    doubtful = found(arm, CarriedBody(MASS, CENTRE, deviation=0.05 * MASS), 0.02)
    np.testing.assert_allclose(values(sure), values(doubtful), rtol=1e-9)
    for one, other in zip(sure.gains, doubtful.gains, strict=True):
        assert other.deviation == pytest.approx(np.hypot(one.deviation, 0.05))
    np.testing.assert_allclose(np.asarray(doubtful.covariance) - np.asarray(sure.covariance), 0.05**2, rtol=1e-6)


def test_a_vertical_axis_that_nothing_else_tells_is_named(scara: Robot) -> None:
    """Gravity acts on the slide of a SCARA alone; a payload of unknown inertia on the last axis tells it nothing."""
    arm = LoadedArm(scara, np.array([20.0, 12.0, 300.0, 2.0]), seconds=8.0)
    logs = [arm.log(False, 0.05)], [arm.log(True, 0.05)]
    gains = gains_from_payload(arm.model, *logs, CarriedBody(MASS), GIVEN)
    slide, turn = gains.gains[2], gains.gains[3]
    assert slide.label == "identified" and slide.unit == "N/A"
    assert slide.low <= 300.0 <= slide.high
    assert turn.label in ("identified", "not determined")
    still = replace(arm, robot=scara.with_gravity([0.0, 0.0, 0.0]))
    quiet = [
        replace(log, current=_still(log.current, seed)) for seed, log in enumerate((arm.log(False), arm.log(True)))
    ]
    open_ = gains_from_payload(still.model, [quiet[0]], [quiet[1]], CarriedBody(MASS), GIVEN)
    assert not open_.complete
    assert all("not act about this axis" in gain.reason for gain in open_.gains if not gain.known)


def _still(current: np.ndarray | None, seed: int) -> np.ndarray:
    """Return currents of noise alone."""
    return np.random.default_rng(seed).normal(size=np.asarray(current).shape)


def test_logs_that_cannot_serve_are_refused(spatial_3r: Robot) -> None:
    arm = LoadedArm(spatial_3r, np.array([14.0, 9.0, 6.0]))
    free, heavy = arm.log(False), arm.log(True)
    model, payload = arm.model, CarriedBody(MASS)
    with pytest.raises(LogMismatch, match="no motor currents; map the columns of the currents"):
        gains_from_payload(model, [replace(free, current=None)], [heavy], payload, GIVEN)
    with pytest.raises(LogMismatch, match="no log with the payload; give one"):
        gains_from_payload(model, [free], [], payload, GIVEN)
    dead = np.array(free.current)
    dead[:, 1] = 0.25
    with pytest.raises(LogMismatch, match=r"the current of joint2 is 0\.25 A throughout"):
        gains_from_payload(model, [replace(free, current=dead)], [heavy], payload, GIVEN)
    same = replace(free, source=replace(free.source, path="a.csv", sha256="7"))
    with pytest.raises(LogMismatch, match=r"a\.csv: the same content as a\.csv"):
        gains_from_payload(model, [same], [same], payload, GIVEN)
    with pytest.raises(UnknownChoice, match=r"no method for drive gains called 'tsl'; .* did you mean 'tls'"):
        gains_from_payload(model, [free], [heavy], payload, GIVEN, options=GainOptions(method="tsl"))
    with pytest.raises(BadOption, match="level"):
        gains_from_payload(model, [free], [heavy], payload, GIVEN, options=GainOptions(level=1.5))


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"mass": 0.0}, "mass"),
        ({"mass": float("nan")}, "mass"),
        ({"mass": 2500000.0}, "kg"),
        ({"mass": 2.0, "deviation": 1.5}, "below half"),
        ({"mass": 2.0, "centre": [0, 0, 50.0]}, "give metres"),
        ({"mass": 2.0, "inertia": np.eye(3)}, "state its centre"),
        ({"mass": 2.0, "centre": [0, 0, 0], "inertia": np.diag([1.0, 1.0, 5.0])}, "triangle inequality"),
    ],
)
def test_payloads_that_cannot_be(options: dict, text: str) -> None:
    with pytest.raises(BadOption, match=text):
        CarriedBody(**options)


def test_frames_of_the_payload(spatial_3r: Robot) -> None:
    with pytest.raises(UnknownChoice, match="no link or frame for the payload called 'hand'"):
        CarriedBody(1.0, frame="hand").place(spatial_3r)
    link, known, free, words = CarriedBody(2.0, frame="link2").parameters(spatial_3r)
    assert link == 1 and free.shape == (10, 9) and len(words) == 9
    np.testing.assert_array_equal(known, [0] * 9 + [2.0])


@pytest.mark.parametrize("method", METHODS)
def test_a_payload_whose_known_part_does_nothing_is_refused(pendulum: Robot, method: str) -> None:
    """A pendulum feels the first moment and the inertia of a payload about its axis, never its mass alone."""
    arm = LoadedArm(pendulum, np.array([14.0]))
    with pytest.raises(BadOption, match="nothing known asks a torque of any joint"):
        found(arm, CarriedBody(MASS), method=method)
    np.testing.assert_allclose(values(found(arm, CarriedBody(MASS, CENTRE))), arm.gains, rtol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_a_payload_before_a_joint_leaves_no_gain_without_a_verdict(spatial_3r: Robot, method: str) -> None:
    arm = LoadedArm(spatial_3r, np.array([14.0, 9.0, 6.0]))
    logs = [arm.log(False, 0.02)], [arm.log(False, 0.02, seed=7)]
    if method == "tls":  # with noise alone in the column of what is known, the smallest singular vector is not its
        with pytest.raises(SolverFailed, match="use the method 'structured'"):
            gains_from_payload(
                arm.model, *logs, CarriedBody(1e-6, CENTRE, frame="link2"), GIVEN, options=GainOptions(method=method)
            )
        return
    gains = gains_from_payload(
        arm.model, *logs, CarriedBody(1e-6, CENTRE, frame="link2"), GIVEN, options=GainOptions(method=method)
    )
    assert all(np.isfinite(gain.residual) for gain in gains.gains)
    assert all(gain.reason for gain in gains.gains if not gain.known)


def test_currents_of_one_sign_have_one_gain(spatial_3r: Robot) -> None:
    arm = LoadedArm(spatial_3r, np.array([14.0, 9.0, 6.0]))
    logs = [replace(log, current=_lifted(log.current)) for log in (arm.log(False), arm.log(True))]
    gains = gains_from_payload(
        arm.model, [logs[0]], [logs[1]], CarriedBody(MASS), GIVEN, options=GainOptions(signed=True)
    )
    up, down = gains.gains[4:]
    assert up.known and up.value == pytest.approx(6.0, rel=1e-6)
    assert not down.known and "no row tells it from the rest" in down.reason


def _lifted(current: np.ndarray | None) -> np.ndarray:
    """Return currents of which the last drive's stay above zero: the offset of its friction takes that up."""
    found = np.array(current)
    found[:, 2] += 60.0
    return found


def test_drives_are_not_asked_for(spatial_3r: Robot) -> None:
    """Gains that the robot states already change nothing."""
    arm = LoadedArm(spatial_3r, np.array([14.0, 9.0, 6.0]))
    stated = arm.robot.with_drives({"joint1": Drive(gain=99.0)})
    logs = [arm.log(False)], [arm.log(True)]
    found_ = gains_from_payload(replace(arm.model, robot=stated), *logs, CarriedBody(MASS), GIVEN)
    np.testing.assert_allclose(values(found_), arm.gains, rtol=1e-6)
