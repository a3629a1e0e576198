"""What the picture is made of: inertia ellipsoids by their closed form, curves without lost peaks, kinds of files."""

from __future__ import annotations

import base64
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident import Inertia, read_robot
from dynident.model.joint import rotation_about
from dynident.robot_files import shipped_robots
from dynident.studio.preview import curves, decimated
from dynident.studio.scene import ellipsoid, scene_of

SIZES = st.floats(0.01, 2.0)


@given(st.tuples(SIZES, SIZES, SIZES), st.floats(0.1, 100.0), st.floats(-3.0, 3.0))
def test_the_ellipsoid_has_the_inertia_it_stands_for(
    axes: tuple[float, float, float], mass: float, turn: float
) -> None:
    squares = np.square(axes)
    rotation = rotation_about(np.array([1.0, 2.0, 2.0]) / 3.0, turn)
    solid = mass / 5.0 * (squares.sum() * np.eye(3) - np.diag(squares))
    found = ellipsoid(Inertia.from_centre_of_mass(mass, [0.3, -0.2, 0.1], rotation @ solid @ rotation.T))
    assert found is not None
    half, frame = found
    again = mass / 5.0 * (np.square(half).sum() * np.eye(3) - np.diag(np.square(half)))
    np.testing.assert_allclose(frame @ again @ frame.T, rotation @ solid @ rotation.T, atol=1e-7 * mass)
    assert np.linalg.det(frame) == pytest.approx(1.0)


def test_no_body_has_no_ellipsoid() -> None:
    assert ellipsoid(Inertia.from_centre_of_mass(1.0, [0, 0, 0], np.diag([1.0, 1.0, 3.0]))) is None
    assert ellipsoid(Inertia.from_vector(np.zeros(10))) is None


@pytest.mark.parametrize("name", shipped_robots())
def test_a_scene_is_plain_data_of_every_robot(name: str, tmp_path: Path) -> None:
    robot = read_robot(name)
    scene = json.loads(json.dumps(scene_of(robot, tmp_path), allow_nan=False))
    assert [joint["name"] for joint in scene["joints"]] == list(robot.joint_names)
    assert [link["parent"] for link in scene["links"]] == [joint.parent for joint in robot.joints]
    assert scene["notes"] == []


def test_a_case_shows_the_capsules_of_its_workspace(tmp_path: Path) -> None:
    from dynident.studio.folder import Folder
    from dynident.studio.views import robot_view

    (tmp_path / "c.yaml").write_text("case: 1\nrobot: er16\nworkspace:\n  joint_radius: 0.07\n")
    scene = robot_view(Folder(tmp_path), "c.yaml")
    assert {capsule["radius"] for link in scene["links"] for capsule in link["capsules"]} == {0.07}
    assert not any(link["capsules"] for link in scene_of(read_robot("er16"), tmp_path)["links"])


def test_a_mesh_that_is_not_there_is_a_remark(tmp_path: Path) -> None:
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(
        "<robot name='a'><link name='b'/><link name='l'><collision><geometry><mesh filename='no.stl'/></geometry>"
        "</collision></link><joint name='j' type='continuous'><parent link='b'/><child link='l'/></joint></robot>"
    )
    scene = scene_of(read_robot(urdf), tmp_path)
    assert len(scene["notes"]) == 1 and "no.stl" in scene["notes"][0] and str(tmp_path) not in scene["notes"][0]


def test_meshes_are_found_beneath_the_session_and_the_missing_are_named(tmp_path: Path) -> None:
    corners = np.arange(18.0).reshape(2, 3, 3) ** 1.5
    facets = b"".join(bytes(12) + facet.astype("<f4").tobytes() + bytes(2) for facet in corners)
    (tmp_path / "upper.stl").write_bytes(bytes(80) + len(corners).to_bytes(4, "little") + facets)
    shape = "<collision><origin xyz='1 2 3' rpy='0 0 1.5707963267948966'/><geometry><mesh filename='{}'/></geometry>"
    links = "".join(
        f"<link name='{name}'>{shape.format(f'package://arm/meshes/{name}.stl')}</collision></link>"
        for name in ("upper", "lower")
    )
    joints = "".join(
        f"<joint name='j{k}' type='continuous'><parent link='{one}'/><child link='{two}'/></joint>"
        for k, (one, two) in enumerate((("base", "upper"), ("upper", "lower")))
    )
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(f"<robot name='a'><link name='base'/>{links}{joints}</robot>")
    scene = scene_of(read_robot(urdf), tmp_path)
    (drawn,) = scene["links"][0]["meshes"]
    seen = np.frombuffer(base64.b64decode(drawn), "<f4").reshape(2, 3, 3)
    turned = np.stack([-corners[..., 1], corners[..., 0], corners[..., 2]], axis=-1)  # by 90 degrees about z
    np.testing.assert_allclose(seen, turned + np.array([1.0, 2.0, 3.0]), rtol=1e-6)
    assert scene["links"][1]["meshes"] == [] and scene["links"][0]["capsules"]
    assert len(scene["notes"]) == 1 and "lower.stl" in scene["notes"][0]


@pytest.mark.parametrize(
    ("name", "across", "last"),
    [("time_ms", "time [s]", 0.099), ("t", "t, from its first value", 99.0), ("q9", "row", 99.0)],
)
def test_a_log_is_drawn_over_its_time(tmp_path: Path, name: str, across: str, last: float) -> None:
    log = tmp_path / "a.csv"
    log.write_text(f"{name},q1\n" + "".join(f"{7 + k},{k % 7}\n" for k in range(100)))
    found = curves(log, ("q1",))
    assert found["across"] == across and found["curves"][0]["x"][::99] == [0.0, pytest.approx(last)]


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=400), st.integers(1, 20))
def test_no_peak_is_lost(values: list[float], buckets: int) -> None:
    curve = decimated(np.array(values), buckets)
    assert max(curve["y"]) == max(values) and min(curve["y"]) == min(values)  # type: ignore[type-var]
    assert curve["x"] == sorted(curve["x"]) and len(curve["x"]) <= max(2 * buckets, 1)  # type: ignore[type-var]
    assert [values[int(x)] for x in curve["x"]] == curve["y"]  # type: ignore[arg-type]


def test_gaps_of_a_curve_stay_gaps() -> None:
    curve = decimated(np.full(100, np.nan), 10)
    assert curve["y"] == [None] * 10
