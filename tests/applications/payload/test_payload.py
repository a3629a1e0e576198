"""A payload as a difference: truth within its intervals, verdicts, what is possible, vendors' words."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from benchmarks import loaded_arm

from arm_models import model_of
from dynident import Estimate, FourierSeries, Inertia, Log, Robot, identify
from dynident.applications.payload import BeforeRun, CarriedLoad, identify_payload, vendor_forms
from dynident.applications.payload.flanges import chosen_end, ends_of, frames_beside
from dynident.applications.payload.gain_doubt import variance_of_shares
from dynident.applications.payload.statement import PayloadFit, mass_doubt, possible_body, stated
from dynident.applications.payload.vendor_forms import angles_zyx, forms_of, principal_axes, quaternion
from dynident.arrays import Array
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.errors import BadOption, LogMismatch, UnknownChoice
from dynident.model.friction import Motion
from dynident.model.joint import Joint, Mimic, rotation_about
from dynident.model.robot import Frame, Link

BODY = Inertia.from_centre_of_mass(2.6, [0.05, 0.1, 0.04], np.diag([0.02, 0.015, 0.012]))
GIVEN = Preprocessing(AsGiven(), rest="keep")


def with_body(robot: Robot) -> Robot:
    return loaded_arm.with_body(robot, BODY)


def run_of(robot: Robot, seed: int, noise: float = 0.2, warm: float = 1.0) -> Log:
    model, generator = model_of(robot, "coulomb", "viscous", "offset"), np.random.default_rng(seed)
    assert robot.nominal is not None
    time = np.arange(600) / 50.0
    sine, cosine = 0.3 * np.random.default_rng(seed).normal(size=(2, robot.dof, 5))
    q, dq, ddq = FourierSeries(np.zeros(robot.dof), sine, cosine, 6.0).evaluate(time)
    theta = np.concatenate([robot.nominal, warm * np.tile([2.0, 3.0, 0.4], robot.dof)])
    torque = model.torque(Motion(q, dq, ddq), theta) + noise * generator.normal(size=q.shape)
    return Log(robot.joint_names, time, q, dq, ddq, torque)


def postures_of(robot: Robot, noise: float = 0.05) -> Log:
    held = np.random.default_rng(3).uniform(-1.2, 1.2, size=(8, robot.dof))
    q = np.concatenate([np.tile(one, (60, 1)) for one in held])
    none = np.zeros_like(q)
    assert robot.nominal is not None
    theta = np.concatenate([robot.nominal, np.tile([2.0, 3.0, 0.4], robot.dof)])
    torque = model_of(robot, "coulomb", "viscous", "offset").torque(Motion(q, none, none), theta)
    torque = torque + noise * np.random.default_rng(4).normal(size=q.shape)
    speed = np.where(np.arange(len(q))[:, None] % 60 < 5, 1.0, none)  # it comes to each posture from another one
    return Log(robot.joint_names, np.arange(len(q)) / 50.0, q, speed, none, torque)


@pytest.fixture(scope="module")
def estimate(robot: Robot) -> Estimate:
    return identify(model_of(robot, "coulomb", "viscous", "offset"), [run_of(robot, 1)], "wls", GIVEN)


@pytest.mark.parametrize(("share", "warm"), [(1.0, 1.2), (0.0, 1.0)])
def test_all_ten_are_found_within_their_intervals(robot: Robot, estimate: Estimate, share: float, warm: float) -> None:
    found = identify_payload(estimate, [run_of(with_body(robot), 2, warm=warm)], known=BeforeRun(friction_share=share))
    away = np.array([one.value for one in found.parameters]) - BODY.vector
    halves = np.array([one.half_width for one in found.parameters])
    assert np.all(np.abs(away) < 2.5 * halves) and np.sum(np.abs(away) < halves) >= 7
    assert found.rows == "motion" and found.placed and found.body.is_consistent()
    assert found.body.mass == pytest.approx(2.6, abs=2 * found.mass.half_width)
    assert found.parts["noise"] > 0 and found.parts["robot"] > 0 and found.parts["gains"] == 0
    assert all(with_it < without for without, with_it in found.residual.values())


def test_the_robots_own_doubt_is_part_of_the_payloads(robot: Robot, estimate: Estimate) -> None:
    log = run_of(with_body(robot), 2)
    sure = identify_payload(replace(estimate, covariance=0.0 * estimate.covariance), [log])
    unsure = identify_payload(replace(estimate, covariance=9.0 * estimate.covariance), [log])
    assert sure.parts["robot"] == 0 and unsure.mass.half_width > sure.mass.half_width


def test_exact_data_give_the_exact_payload(robot: Robot) -> None:
    exact = identify(model_of(robot, "coulomb", "viscous", "offset"), [run_of(robot, 1, noise=0.0)], "wls", GIVEN)
    found = identify_payload(exact, [run_of(with_body(robot), 2, noise=0.0)])
    np.testing.assert_allclose([one.value for one in found.parameters], BODY.vector, atol=1e-6)


def test_drive_gains_and_a_stated_mass(robot: Robot, estimate: Estimate) -> None:
    log = run_of(with_body(robot), 2)
    doubted = identify_payload(estimate, [log], known=BeforeRun(gain_deviation=0.05))
    assert 0.01 * 2.6 < doubted.parts["gains"] < 0.08 * 2.6
    told = identify_payload(estimate, [log], known=BeforeRun(mass=2.6, mass_deviation=0.001))
    assert told.mass.value == pytest.approx(2.6, abs=0.002) and told.mass.half_width < 0.003
    assert told.centre[1].half_width <= identify_payload(estimate, [log]).centre[1].half_width * 1.001


def test_joints_that_disagree_say_how_far_gains_are_off(robot: Robot) -> None:
    """Currents, the gains of which are wrong in both runs alike; what the joints have in common stays unseen."""
    errors = 1.0 + np.array([0.06, -0.05, 0.07, -0.04, 0.05, -0.06])

    def found_with(factors: Array) -> CarriedLoad:
        empty, loaded = (run_of(one, seed, 0.05) for one, seed in ((robot, 1), (with_body(robot), 2)))
        empty, loaded = (replace(log, torque=np.asarray(log.torque) * factors) for log in (empty, loaded))
        loaded = replace(loaded, current=np.asarray(loaded.torque) / 10.0)
        return identify_payload(
            identify(model_of(robot, "coulomb", "viscous", "offset"), [empty], "wls", GIVEN), [loaded]
        )

    wrong, right = found_with(errors), found_with(np.ones(6))
    assert abs(wrong.mass.value - 2.6) <= wrong.mass.half_width <= 0.3 * 2.6
    assert wrong.parts["gains"] > 3 * wrong.parts["noise"]
    assert any("off by" in remark and "dynident gains" in remark for remark in wrong.remarks)
    assert right.mass.half_width < 0.3 * wrong.mass.half_width


def test_the_variance_of_gains_is_that_of_the_scores() -> None:
    generator, variance = np.random.default_rng(0), 0.05**2
    root = generator.normal(size=(6, 5)) * 600.0
    matrix = root @ root.T  # of rank 5: one combination of gains is not seen
    values, vectors = np.linalg.eigh(matrix)
    spread = vectors * np.sqrt(np.maximum(values + variance * values**2, 0.0))
    draws = [variance_of_shares(matrix, spread @ generator.normal(size=6)) for _ in range(400)]
    assert np.mean([found for found, _ in draws]) == pytest.approx(variance, rel=0.1)
    assert np.median([degrees for _, degrees in draws]) == pytest.approx(5.0, abs=0.5)
    assert variance_of_shares(matrix, np.zeros(6)) == (0.0, np.inf)


def test_postures_tell_mass_and_centre_only(robot: Robot, estimate: Estimate) -> None:
    found = identify_payload(estimate, [postures_of(with_body(robot))])
    assert found.rows == "poses" and found.samples == 8
    assert [one.label for one in found.parameters[:6]] == ["not determined"] * 6
    assert abs(found.mass.value - 2.6) < found.mass.half_width < 1.3
    assert "postures tell mass and centre of mass only" in " ".join(found.remarks)
    assert found.body.is_consistent()


def test_the_frames_of_the_last_link_are_named_where_nothing_is_stated(robot: Robot, estimate: Estimate) -> None:
    """A tool of the robot model or a stated frame stands without a word, as do frames that are that of the link."""
    last, log = robot.dof - 1, run_of(with_body(robot), 2)
    frames = {"mount": Frame(last, np.eye(3), np.zeros(3)), "camera": Frame(last, np.eye(3), np.array([0, 0, 0.1]))}

    def told(more: dict[str, Frame], flange: str = "", tool: str = "") -> str:
        model = replace(estimate.model, robot=replace(robot, frames={**robot.frames, **more}, tool=tool))
        own = {name: frame for name, frame in model.robot.frames.items() if frame.link != last or name in more}
        model = replace(model, robot=replace(model.robot, frames=own))
        return " ".join(identify_payload(replace(estimate, model=model), [log], flange=flange).remarks)

    tcp = {**frames, "tcp": Frame(last, rotation_about(np.array([1.0, 0, 0]), 0.3), np.zeros(3))}
    assert "these frames on it: tcp, camera (--flange NAME)" in told(tcp)
    for quiet in (told(tcp, flange="camera"), told(tcp, tool="tcp"), told({"mount": frames["mount"]})):
        assert "these frames on it" not in quiet


def two_armed(robot: Robot, other: Robot) -> Robot:
    """Return a robot of two arms on one base."""
    links, joints, frames = list[Link](), list[Joint](), dict[str, Frame]()
    for side, arm in (("left", robot), ("right", other)):
        first = len(links)
        links += [replace(link, name=f"{side}_{link.name}") for link in arm.links]
        parents = [joint.parent + first if joint.parent >= 0 else -1 for joint in arm.joints]
        joints += [replace(j, name=f"{side}_{j.name}", parent=k) for j, k in zip(arm.joints, parents, strict=True)]
        frames[f"{side}_tcp"] = Frame(len(links) - 1, np.eye(3), np.array([0.0, 0.0, 0.1]))
    return Robot("two arms", tuple(links), tuple(joints), frames=frames)


@pytest.mark.parametrize("arms", ["6-6", "2-6", "6-2"])
def test_the_end_of_a_robot_of_two_arms_that_carries_the_load_is_found(
    robot: Robot, planar_2r: Robot, arms: str
) -> None:
    """The last link of the file had been taken, and a load on the other arm was none."""
    one, other = ({"6": robot, "2": planar_2r}[name] for name in arms.split("-"))
    both = two_armed(one, other)
    estimate = identify(model_of(both, "coulomb", "viscous", "offset"), [run_of(both, 1)], "wls", GIVEN)
    ends = (both.links[-1].name, both.links[len(one.links) - 1].name)
    assert ends_of(both) == ends and ends_of(one) == (one.tool or one.links[-1].name,)

    def with_load(*at: str) -> CarriedLoad:
        links = tuple(
            replace(link, inertia=link.inertia + BODY) if link.name in at and link.inertia is not None else link
            for link in both.links
        )
        return identify_payload(estimate, [run_of(replace(both, links=links), 2)])

    for end in ends:
        found = with_load(end)
        assert found.frame == found.link == end
        assert abs(found.mass.value - 2.6) <= 1.5 * found.mass.half_width
        text = f"of the ends of the robot the load is at {end}: "
        assert found.remarks[0].startswith(text) and f"frames on it: {end.split('_')[0]}_tcp" in found.remarks[1]
    loaded = with_load(*ends)
    other = next(end for end in ends if end != loaded.frame)
    words = f"a load at {other} as well lowers the weighted squares: weigh it by --flange {other}"
    assert words in loaded.remarks or arms == "6-2"  # two planar joints beside six: below a twentieth
    empty = identify_payload(estimate, [run_of(both, 3)])
    assert empty.frame == ends[0] and not any("ends of the robot" in one for one in empty.remarks)
    still = both.locked({name: 0.3 for name in both.joint_names if name.startswith("right")})
    assert ends_of(still) == (ends[1],)


@pytest.mark.parametrize("kind", ["prismatic", "revolute"])
def test_a_load_is_stated_in_the_frame_of_what_carries_the_fingers(
    robot: Robot, kind: Literal["prismatic", "revolute"]
) -> None:
    """The last of the fingers had been the tool."""
    robot = replace(robot, frames={}, tool="")
    last, body = len(robot.links) - 1, Inertia.from_centre_of_mass(0.05, [0.0, 0.0, 0.03], 1e-5 * np.eye(3))
    at, axis = (np.array([0.0, side, 0.1]) for side in (0.02, -0.02)), np.array([0.0, 1.0, 0.0])
    left, right = (Joint(name, kind, last, np.eye(3), place, axis) for name, place in zip(("l", "r"), at, strict=True))
    fingers = (*robot.joints, left, replace(right, mimic=Mimic("l", -1.0)))
    gripper = replace(
        robot,
        joints=fingers,
        links=(*robot.links, Link("finger_left", body), Link("finger_right", body)),
        coupling=np.eye(robot.dof + 1),
    )
    tip = robot.links[last].name
    assert ends_of(gripper) == (tip,)
    held = gripper.locked({"l": 0.01})
    assert held.tool == "" and ends_of(held) == (tip,)
    (remark,) = frames_beside(held, tip)
    assert "finger_left, finger_right (--flange NAME)" in remark
    wrist = robot.locked({robot.joint_names[-1]: 0.4})  # no finger: the last link stays the tool
    assert wrist.tool == tip and ends_of(wrist) == (tip,)


def test_verdicts_of_a_heavy_load_and_of_a_mass_below_zero(estimate: Estimate) -> None:
    robot = estimate.model.robot
    ten = np.array([26.0, -0.4, 0.0, 26.0, 0.0, 8.0, 0.0, 0.0, 60.0, 150.0])
    half = np.array([0.83, 0.41, 9.0, 0.8, 0.4, 0.4, 1.0, 1.0, 1.0, 0.5])

    def said(mass: float) -> CarriedLoad:
        found = PayloadFit(
            np.r_[ten[:9] if mass > 0 else np.zeros(9), mass],
            np.zeros(10, bool),
            {"noise": np.diag((half / 1.96) ** 2), "gains": np.zeros((10, 10))},
            np.full(10, np.inf),
            (0, np.eye(3), np.zeros(3)),
            "motion",
            1000,
            (np.ones(robot.dof), np.zeros(robot.dof)),
        )
        return stated(found, estimate, robot.links[0].name, 0.95, ("run.csv",), ())

    words = {one.name: one.verdict for one in said(150.0).parameters}
    assert words["Ixx"] == "identified" and words["Ixy"] == "identified, near 0" and words["Ixz"] == "weak"
    below = said(-2.4)
    assert {one.label for one in below.parameters} == {"impossible"} and not below.placed and "m" in below.unknown
    assert said(-0.24).mass.label == "weak"
    assert mass_doubt(below.mass).startswith("no payload has a mass below 0") and not mass_doubt(said(150.0).mass)


def test_ends_that_the_log_does_not_tell_apart_are_named() -> None:
    assert chosen_end(("palm", "left", "right"), (0.0, 900.0, 899.0))[0] == "left"
    name, (remark,) = chosen_end(("left", "right", "head"), (900.0, 905.0, 3.0))
    assert name == "left" and "at which end of the robot the load is: left, right; " in remark
    assert chosen_end(("left", "right"), (3.0, 12.0)) == ("left", [])
    assert chosen_end(("left",), (900.0,)) == ("left", [])


def test_a_stated_mass_that_the_log_contradicts_is_not_obeyed(robot: Robot, estimate: Estimate) -> None:
    """It had been: half the mass gave a centre twice as far out, and a command for the controller."""
    log = run_of(with_body(robot), 2)
    weighed = identify_payload(estimate, [log]).mass.value
    found = identify_payload(estimate, [log], known=BeforeRun(mass=0.5 * weighed, mass_deviation=0.01))
    assert f"which contradicts the stated {0.5 * weighed:g} kg" in found.contradiction and not found.placed
    numbers = (*found.parameters, *found.centre)
    assert {one.label for one in numbers} <= {"contradicted", "weak"} and found.mass.label == "contradicted"
    with pytest.raises(BadOption, match="the log alone weighs"):
        vendor_forms(found)
    for mass, told in ((weighed, False), (1.05 * weighed, True)):  # within what scales of the torques may make
        for level in (0.5, 0.95):
            right = identify_payload(estimate, [log], known=BeforeRun(mass=mass), level=level)
            assert right.placed and not right.contradiction
            assert any("the log alone weighs" in remark for remark in right.remarks) == told
            assert not any("no payload explains" in remark for remark in right.remarks)


def test_torques_that_no_payload_explains_give_no_form(robot: Robot, estimate: Estimate) -> None:
    """An estimate of torques half as large had found 3.8 kg "identified" for 1.2."""
    run = run_of(with_body(robot), 2)
    found = identify_payload(estimate, [replace(run, torque=2.0 * np.asarray(run.torque))])
    assert found.contradiction.startswith("no payload explains the torque of ") and not found.placed
    with pytest.raises(BadOption, match="intervals do not hold"):
        vendor_forms(found)
    assert identify_payload(estimate, [run]).placed
    hose = np.asarray(run.torque) - 0.15 * np.eye(6)[5] * run.q  # at a joint that the payload hardly loads
    assert identify_payload(estimate, [replace(run, torque=hose)]).placed


def test_a_run_without_payload_says_so(robot: Robot, estimate: Estimate) -> None:
    found = identify_payload(estimate, [run_of(robot, 5)])
    assert not found.placed and "no payload is evident" in " ".join(found.remarks)
    with pytest.raises(BadOption, match="not determined well enough"):
        vendor_forms(found)


def test_a_load_that_is_put_down_within_the_log_is_told(robot: Robot, estimate: Estimate) -> None:
    empty, loaded, warm = run_of(robot, 2), run_of(with_body(robot), 2), run_of(with_body(robot), 2, warm=1.4)
    first = (empty.time < 6.0)[:, None]

    def told(start: Log, end: Log) -> str:
        torque = np.where(first, np.asarray(start.torque), np.asarray(end.torque))
        return "; ".join(identify_payload(estimate, [replace(loaded, torque=torque)]).remarks)

    changes = re.search(r"not the same all along: (-?[\d.]+) to ([\d.]+) kg .* 'dynident track", told(loaded, empty))
    assert changes is not None
    assert abs(float(changes[1])) < 0.4 and float(changes[2]) == pytest.approx(2.6, abs=0.4)
    for same in ((loaded, loaded), (loaded, warm), (empty, empty)):  # friction alone changes in the second
        assert "not the same all along" not in told(*same)


@pytest.mark.parametrize(("flange", "is_told"), [("link2", True), ("link4", True), ("link6", False), ("", False)])
def test_a_payload_on_another_link_than_the_stated_one_is_named(
    robot: Robot, estimate: Estimate, flange: str, is_told: bool
) -> None:
    """Its load had been no payload at all, or one that nothing explains."""
    names = [link.name for link in robot.links]
    last = estimate.model.robot.frames[robot.tool].link if robot.tool in robot.frames else len(names) - 1
    own = names[int(flange[-1]) - 1] if flange else ""
    found = identify_payload(estimate, [run_of(with_body(robot), 2)], flange=own)
    told = [
        one for one in found.remarks if one.startswith(f"a payload on {names[last]} explains the torques far better")
    ]
    assert bool(told) is is_told is bool(found.contradiction) is not found.placed
    assert not is_told or "--flange " in told[0]


def test_a_log_of_another_robot_says_so(robot: Robot, estimate: Estimate) -> None:
    """Two columns are exchanged, or all torques have the other sign."""
    log = run_of(with_body(robot), 2)
    assert log.torque is not None
    swapped = replace(log, torque=np.asarray(log.torque)[:, [1, 0, 2, 3, 4, 5]])
    remarks = identify_payload(estimate, [swapped]).remarks
    assert any(one.startswith("no payload explains the torque of") for one in remarks)
    below = identify_payload(estimate, [replace(log, torque=-np.asarray(log.torque))])
    assert below.mass.value + below.mass.half_width < 0 and not below.placed
    assert any(one.startswith("no payload has a mass below 0") for one in below.remarks)
    own = identify_payload(estimate, [log]).remarks
    assert not any(one.startswith(("no payload", "no body")) for one in own)


@pytest.mark.parametrize(
    ("options", "kind", "text"),
    [
        ({"known": BeforeRun(mass=-1.0)}, BadOption, "above 0"),
        ({"known": BeforeRun(mass_deviation=0.1)}, BadOption, "of a stated mass"),
        ({"rows": "all"}, BadOption, "choose 'auto'"),
        ({"known": BeforeRun(friction_share=-1.0)}, BadOption, "share of the friction"),
        ({"known": BeforeRun(gain_deviation=2.0)}, BadOption, "share of the gain"),
        ({"level": 0.2}, BadOption, "confidence"),
        ({"flange": "nowhere"}, UnknownChoice, "no link or frame"),
        ({"rows": "poses"}, LogMismatch, "stands still at 0 postures"),
    ],
)
def test_refusals(
    robot: Robot, estimate: Estimate, options: dict[str, object], kind: type[Exception], text: str
) -> None:
    with pytest.raises(kind, match=text):
        identify_payload(estimate, [run_of(robot, 5)], **options)  # type: ignore[arg-type]


def test_the_possible_body_is_the_ten_where_they_are_one_and_the_prior_where_nothing_is_known() -> None:
    ball = Inertia.from_centre_of_mass(2.0, [0, 0, 0], 0.01 * np.eye(3))
    np.testing.assert_allclose(possible_body(BODY.vector, 1e10 * np.eye(10), ball).vector, BODY.vector, atol=1e-6)
    np.testing.assert_allclose(possible_body(BODY.vector, np.zeros((10, 10)), ball).vector, ball.vector, atol=1e-6)
    broken = BODY.vector.copy()
    broken[0] = -0.1
    assert possible_body(broken, 1e8 * np.eye(10), ball).is_consistent()


def test_logs_that_cannot_tell_a_payload(robot: Robot, estimate: Estimate) -> None:
    with pytest.raises(LogMismatch, match="no log; give at least one log with the payload"):
        identify_payload(estimate, [])
    log = run_of(robot, 5)
    own = replace(log, source=replace(log.source, path="run.csv", sha256="a" * 64))
    known = replace(estimate, provenance={**estimate.provenance, "logs": [{"sha256": "a" * 64}]})
    with pytest.raises(LogMismatch, match=r"run\.csv: the robot without the payload was identified from it"):
        identify_payload(known, [own])
    with pytest.raises(LogMismatch, match="no torques; map torque columns"):
        identify_payload(estimate, [replace(log, torque=None)])


@pytest.mark.parametrize("b", [np.pi / 2, -np.pi / 2])
def test_angles_of_a_turn_about_one_axis_alone(b: float) -> None:
    """At 90 degrees about y the other two turn about one axis: one of them is zero, and the rotation is the same."""
    axes = rotation_about([0, 0, 1], 0.4) @ rotation_about([0, 1, 0], b) @ rotation_about([1, 0, 0], 1.1)
    first, second, third = angles_zyx(axes)
    again = rotation_about([0, 0, 1], first) @ rotation_about([0, 1, 0], second) @ rotation_about([1, 0, 0], third)
    np.testing.assert_allclose(again, axes, atol=1e-14)
    assert third == 0.0


def test_principal_axes_are_a_rotation_for_any_body() -> None:
    generator = np.random.default_rng(0)
    for _ in range(50):
        root = generator.normal(size=(3, 3))
        moments, axes = principal_axes(root @ root.T)
        np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, root @ root.T, atol=1e-12)
        assert np.linalg.det(axes) == pytest.approx(1.0)


def test_vendor_forms_say_the_same_body() -> None:
    turn = rotation_about([0.6, 0.0, 0.8], 0.7)
    inertia = turn @ np.diag([0.02, 0.03, 0.04]) @ turn.T
    moments, axes = principal_axes(inertia)
    np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, inertia, atol=1e-14)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    a, b, c = angles_zyx(axes)
    again = rotation_about([0, 0, 1], a) @ rotation_about([0, 1, 0], b) @ rotation_about([1, 0, 0], c)
    np.testing.assert_allclose(again, axes, atol=1e-14)
    w, *xyz = quaternion(axes)
    angle = 2 * np.arctan2(np.linalg.norm(xyz), w)
    np.testing.assert_allclose(rotation_about(np.array(xyz) / np.linalg.norm(xyz), angle), axes, atol=1e-14)
    forms = forms_of(Inertia.from_centre_of_mass(2.0, [0.01, -0.02, 0.03], np.diag([0.02, 0.03, 0.04])))
    assert forms["universal_robots"] == "set_target_payload(2, [0.01, -0.02, 0.03], [0.02, 0.03, 0.04, 0, 0, 0])"
    assert "M 2, CM {X 10.0000, Y -20.0000, Z 30.0000, A 0.0000, B 0.0000, C 0.0000}" in forms["kuka"]
    assert "[2, [10.0000, -20.0000, 30.0000], [1.00000000, 0.00000000, 0.00000000, 0.00000000], 0.02," in forms["abb"]
