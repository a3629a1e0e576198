"""URDF: only what was identified changes, and every engine reads the same torques from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identified_arms import URDF, estimate_of

from dynident.data.log import Log
from dynident.errors import DescriptionError
from dynident.exports.models import MODEL_EXPORTERS, export_model
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.plausibility import TOTAL_MASS, ContradictedBound, Plausibility
from dynident.model.inertia import Inertia
from dynident.model.robot import Robot
from dynident.model.shapes import Capsule
from dynident.robot_files.formats.urdf import read_urdf

LOCKED = {"grip": 0.04}


@pytest.fixture(scope="module")
def arm() -> Robot:
    return read_urdf("arm.urdf", URDF.encode())


@pytest.fixture(scope="module")
def moving(arm: Robot, exact_log: Callable[..., Log]) -> Estimate:
    """All joints move; the follower follows."""
    return estimate_of(arm, exact_log, exact=True)


@pytest.fixture(scope="module")
def locked(arm: Robot, exact_log: Callable[..., Log]) -> Estimate:
    """The gripper is locked: fingers and tool are one body with the lower arm."""
    return estimate_of(arm.locked(LOCKED), exact_log, exact=True)


def written(estimate: Estimate, folder: Path, text: str | bytes = URDF, lump: bool = False) -> tuple[bytes, bytes]:
    data = text.encode() if isinstance(text, str) else text
    (folder / "arm.urdf").write_bytes(data)
    part = MODEL_EXPORTERS.make("urdf", {"lump": lump})
    found = export_model(estimate, part, folder / "out.urdf", description=folder / "arm.urdf")
    relative = [proof.relative for proof in found.proofs if proof.relative is not None]
    assert len(relative) >= 2 and max(relative) < 1e-9
    return data, (folder / "out.urdf").read_bytes()


def test_only_inertias_and_friction_change(moving: Estimate, tmp_path: Path) -> None:
    """Lines that hold none of the five elements stay, in their order; so do comments, odd blanks and quotes."""
    before, after = written(moving, tmp_path)
    kept = [
        line for line in before.decode().splitlines() if not any(t in line for t in ("<origin rpy", 'xyz="0.1 0.02'))
    ]
    new = after.decode().splitlines()
    untouched = [line for line in kept if line in new]
    parts = ("<mass", "<inertia ", "<dynamics", "<inertial>")
    assert all(any(part in line for part in parts) for line in kept if line not in new)
    assert [line for line in new if line in untouched] == untouched
    assert "<dynamics friction='" in after.decode() and 'spring_stiffness="1"/>' in after.decode()
    assert "café" in after.decode() and 'rpy="0 0 0"' in after.decode()


def test_the_same_model_again_changes_nothing(moving: Estimate, tmp_path: Path) -> None:
    _, once = written(moving, tmp_path)
    _, twice = written(moving, tmp_path, once)
    again, then = read_urdf("a", once).nominal, read_urdf("b", twice).nominal
    assert again is not None and then is not None
    np.testing.assert_allclose(then, again, rtol=1e-12, atol=1e-15)


def test_line_ends_of_windows_stay(moving: Estimate, tmp_path: Path) -> None:
    _, after = written(moving, tmp_path, URDF.replace("\n", "\r\n"))
    assert after.count(b"\n") == after.count(b"\r\n")


def test_an_encoding_other_than_utf_8_stays(moving: Estimate, tmp_path: Path) -> None:
    text = URDF.replace('encoding="utf-8"', 'encoding="iso-8859-1"')
    _, after = written(moving, tmp_path, text.encode("latin-1"))
    assert "café".encode("latin-1") in after


def test_utf_16_is_refused(moving: Estimate, tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match="UTF-16"):
        written(moving, tmp_path, URDF.replace('encoding="utf-8"', 'encoding="utf-16"').encode("utf-16"))
    assert not (tmp_path / "out.urdf").exists()


def test_fixed_links_keep_what_they_weigh_where_the_rest_is_a_body(moving: Estimate, tmp_path: Path) -> None:
    before, after = written(moving, tmp_path)
    tool = before.decode().split('<link name="tool">')[1].split("</link>")[0]
    assert tool in after.decode()
    _, lumped = written(moving, tmp_path, lump=True)
    assert "<inertial>" not in lumped.decode().split('<link name="tool">')[1].split("</link>")[0]


def test_a_fixed_link_that_is_too_heavy_loses_its_inertia(moving: Estimate, tmp_path: Path) -> None:
    heavy = URDF.replace('<mass value="0.4"/>', '<mass value="50"/>')
    _, after = written(moving, tmp_path, heavy)
    assert "<inertial>" not in after.decode().split('<link name="tool">')[1].split("</link>")[0]


def test_a_fixed_link_that_is_no_body_loses_its_inertia(moving: Estimate, tmp_path: Path) -> None:
    """Engines refuse it, and the moving link would carry the opposite of it."""
    whole, at = 'ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.002"', tmp_path / "arm.urdf"
    at.write_text(URDF.replace(whole, whole.replace('ixy="0"', 'ixy="0.0017"')))  # a principal moment below zero
    found = export_model(moving, "urdf", tmp_path / "out.urdf", description=at)
    assert all((proof.relative or 0.0) < 1e-9 for proof in found.proofs)
    assert "<inertial>" not in (tmp_path / "out.urdf").read_text().split('<link name="tool">')[1].split("</link>")[0]
    assert "no body has the inertia that the file states for tool" in found.notes
    flat = whole.replace('izz="0.002"', 'izz="0.003"')  # a plate: at the edge of what can be
    _, kept = written(moving, tmp_path, URDF.replace(whole, flat))
    assert flat in kept.decode()


def test_friction_of_followers_is_that_of_their_leader(moving: Estimate, tmp_path: Path) -> None:
    _, after = written(moving, tmp_path)
    follower = next(joint for joint in read_urdf("out", after).joints if joint.name == "follow")
    assert follower.damping == 0.0


def test_what_hangs_on_locked_joints_stays_as_it_is(locked: Estimate, tmp_path: Path) -> None:
    before, after = written(locked, tmp_path)
    for name in ("grip", "follow"):
        joint = before.decode().split(f'<joint name="{name}"')[1].split("</joint>")[0]
        assert joint in after.decode()
    for name in ("finger", "other"):
        assert before.decode().split(f'<link name="{name}">')[1].split("</link>")[0] in after.decode()


def test_heavy_links_behind_locked_joints_keep_a_part_and_a_mass(locked: Estimate, tmp_path: Path) -> None:
    """MuJoCo refuses moving links without a mass: they keep a part, and the sum is still what was identified."""
    heavy = URDF.replace('<mass value="0.2"/>', '<mass value="20"/>')
    _, after = written(locked, tmp_path, heavy)
    bodies = {link.name: link.inertia for link in read_urdf("out", after).links}
    assert bodies["finger"] is not None and 0 < bodies["finger"].mass < 2.5
    theta = locked.theta
    assert theta is not None
    lower = read_urdf("out", after).locked(LOCKED).nominal
    assert lower is not None
    np.testing.assert_allclose(lower[10:20], theta[10:20], rtol=1e-9, atol=1e-12)


def test_a_link_without_an_inertial_gets_one(arm: Robot, exact_log: Callable[..., Log], tmp_path: Path) -> None:
    estimate = estimate_of(arm.locked(LOCKED), exact_log)
    start = URDF.index('<link name="lower">')
    end = URDF.index("</link>", start) + len("</link>")
    _, after = written(estimate, tmp_path, URDF[:start] + '<link name="lower" />' + URDF[end:])
    assert '<link name="lower" >' in after.decode() or '<link name="lower">' in after.decode()


def test_joints_without_friction_in_the_model_keep_their_tags(
    arm: Robot, exact_log: Callable[..., Log], tmp_path: Path
) -> None:
    from dynident.model.friction import FRICTION

    parts = (FRICTION.make("viscous", {"joints": ("elbow", "grip")}),)
    _, after = written(estimate_of(arm, exact_log, parts), tmp_path)
    joints = {joint.name: joint for joint in read_urdf("out", after).joints}
    assert (joints["shoulder"].damping, joints["shoulder"].friction) == (9.0, 7.0)
    assert joints["elbow"].damping and joints["elbow"].damping > 0.05


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<origin xyz="0.4 0 0.1"', '<origin xyz="0.4 0 0.2"'),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 1 0"/>'),
        ('joint name="elbow"', 'joint name="knee"'),
        ('type="continuous"', 'type="fixed"'),
    ],
)
def test_the_urdf_of_another_robot_is_refused(moving: Estimate, tmp_path: Path, old: str, new: str) -> None:
    with pytest.raises(DescriptionError, match=r"joint '(elbow|shoulder)'.*give the robot model that was identified"):
        written(moving, tmp_path, URDF.replace(old, new))
    assert not (tmp_path / "out.urdf").exists()


def test_a_joint_locked_elsewhere_is_found_where_it_is(
    arm: Robot, exact_log: Callable[..., Log], tmp_path: Path
) -> None:
    """Positions of locked joints are not in an estimate: they follow from the frames."""
    estimate = estimate_of(arm.locked({"elbow": 1.9, "grip": -0.02}), exact_log)
    (tmp_path / "arm.urdf").write_text(URDF, encoding="utf-8")
    found = export_model(estimate, "urdf", tmp_path / "o.urdf", description=tmp_path / "arm.urdf")
    assert any("elbow at 1.9" in note and "grip at -0.02" in note for note in found.notes)


def test_a_new_urdf_tells_of_another_gravity(
    random_tree: Callable[..., Robot], exact_log: Callable[..., Log], tmp_path: Path
) -> None:
    for gravity, told in (((0, 0, -9.81), False), ((0, 0, -9.7), True)):
        robot = random_tree(0).with_gravity(gravity)
        notes = export_model(
            estimate_of(robot, exact_log, estimator="wls", exact=True), "urdf", tmp_path / "n.urdf"
        ).notes
        line = "gravity is (0, 0, -9.7) m/s², which a URDF cannot say: set it where it is loaded"
        assert (line in notes) == told == any("gravity" in note for note in notes)


def test_a_new_urdf_gives_the_robot_back(
    random_tree: Callable[..., Robot], exact_log: Callable[..., Log], tmp_path: Path
) -> None:
    """Poses to rounding, bodies to rounding, also at orientations where roll and yaw are one."""
    for seed in range(3):
        estimate = estimate_of(random_tree(seed), exact_log, estimator="wls", exact=True)
        found = export_model(estimate, "urdf", tmp_path / "new.urdf")
        assert "the URDF is new" in found.notes[0]
        known = estimate.model.robot
        robot = read_urdf("new", (tmp_path / "new.urdf").read_bytes())
        poses = {joint.name: joint for joint in robot.joints}
        theta = {link.name: link.inertia for link in robot.links}
        for i, joint in enumerate(known.joints):
            np.testing.assert_allclose(poses[joint.name].rotation, joint.rotation, atol=1e-14)
            assert np.array_equal(poses[joint.name].translation, joint.translation)
            wanted = Inertia.from_vector(np.asarray(estimate.theta)[10 * i : 10 * i + 10])
            body = theta[known.links[i].name]
            assert body is not None
            np.testing.assert_allclose(body.vector, wanted.vector, rtol=1e-12, atol=1e-13)


def test_bodies_beyond_their_bounds_are_named(moving: Estimate, tmp_path: Path) -> None:
    """Those that the data contradict; a stated bound, which is kept, is none."""
    bounds = [("upper", "mass", True), ("lower", "size", True), (TOTAL_MASS, "mass", False)]
    contradicted = tuple(ContradictedBound(name, bound, 40.0, 9.0, 0.1, relaxed) for name, bound, relaxed in bounds)
    for found, told in (((), []), (contradicted, ["mass of upper, size of lower"])):
        run = replace(moving.run, plausibility=Plausibility(1.0, 1.0, 2.0, found, ()))  # type: ignore[call-arg]
        notes = export_model(replace(moving, run=run), "urdf", tmp_path / "o.urdf").notes
        assert [note.split(": ")[1].split(";")[0] for note in notes if note.startswith("beyond the bounds")] == told


def test_capsules_are_shapes_that_engines_read(pendulum: Robot, exact_log: Callable[..., Log], tmp_path: Path) -> None:
    """A cylinder with a sphere at each end: Pinocchio, which passes over <capsule>, holds all points of the capsule."""
    start, end = np.array([0.1, 0.0, 0.2]), np.array([0.3, -0.2, 0.1])
    link = replace(pendulum.links[0], shapes=(Capsule(start, end, 0.05),))
    estimate = estimate_of(replace(pendulum, links=(link,)), exact_log, exact=True)
    export_model(estimate, "urdf", tmp_path / "new.urdf")
    pin = pytest.importorskip("pinocchio")
    model = pin.buildModelFromUrdf(str(tmp_path / "new.urdf"))
    shapes = pin.buildGeomFromUrdf(model, str(tmp_path / "new.urdf"), pin.GeometryType.COLLISION).geometryObjects
    centres = {type(one.geometry).__name__: [] for one in shapes}
    for one in shapes:
        centres[type(one.geometry).__name__].append(one.placement.translation)
    np.testing.assert_allclose(sorted(map(tuple, centres["Sphere"])), sorted([tuple(start), tuple(end)]), atol=1e-12)
    np.testing.assert_allclose(centres["Cylinder"], [(start + end) / 2], atol=1e-12)
    (tube,) = (one for one in shapes if type(one.geometry).__name__ == "Cylinder")
    assert tube.geometry.radius == pytest.approx(0.05)
    assert 2 * tube.geometry.halfLength == pytest.approx(np.linalg.norm(end - start))
    np.testing.assert_allclose(np.cross(tube.placement.rotation[:, 2], end - start), 0.0, atol=1e-12)
