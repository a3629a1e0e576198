"""Equations of small arms as SymPy expressions: equal to the compiled kernels, and to a textbook's closed form."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

import dynident as di
from dynident.cli.main import main
from dynident.model.friction import FRICTION
from dynident.model.joint import Drive, Joint, Mimic, rotation_about
from dynident.model.robot import Link, Robot
from two_joint_arm import URDF

sympy: Any = pytest.importorskip("sympy", reason="equations as expressions need SymPy (extra symbolic)")

Capture = pytest.CaptureFixture[str]
X, Y, Z = np.eye(3)


def random_arm(seed: int, joints: int, *, right: bool) -> Robot:
    """Return a tree of joints of both kinds, its angles right ones or any."""
    random = np.random.default_rng(seed)
    found: list[Joint] = []
    for k in range(joints):
        axis = np.eye(3)[random.integers(3)] if right else random.normal(size=3)
        turn = rotation_about(np.eye(3)[random.integers(3)], float(random.integers(4)) * np.pi / 2)
        if not right:
            turn = turn @ rotation_about(X, float(random.normal()))
        kind: Literal["revolute", "prismatic"] = "prismatic" if random.random() < 0.3 else "revolute"
        parent = k - 1 if random.random() < 0.8 else int(random.integers(-1, k))
        found.append(Joint(f"j{k}", kind, parent, turn, random.normal(size=3).round(2), axis))
    return Robot("arm", tuple(Link(f"l{k}") for k in range(joints)), tuple(found), random.normal(size=3).round(1))


def compared(model: di.DynamicModel, states: int = 8) -> di.SymbolicModel:
    """Check regressor, gravity and torque of the expressions against the kernels, and return the expressions."""
    found = di.symbolic_model(model)
    motion = model.random_motion(states, 3)
    moving = [*found.q, *found.dq, *found.ddq]
    own = sympy.lambdify(moving, found.regressor, cse=True)
    whole = sympy.lambdify([*moving, *found.beta], [found.torque, found.gravity], cse=True)
    random = np.random.default_rng(5)
    expected = model.regressor(motion)[:, :, found.base.independent]
    for row in range(states):
        state = np.concatenate([motion.q[row], motion.dq[row], motion.ddq[row]])
        beta = random.normal(size=found.base.count)
        torque, gravity = whole(*state, *beta)
        scale = np.abs(expected[row]).max()
        np.testing.assert_allclose(np.array(own(*state), float), expected[row], atol=1e-12 * scale)
        theta = found.base.to_standard(beta)
        np.testing.assert_allclose(
            np.array(torque, float)[:, 0],
            model.torque(motion.q[row], motion.dq[row], motion.ddq[row], theta),
            rtol=1e-10,
            atol=1e-10,
        )
        still = di.DynamicModel(model.robot).gravity(motion.q[row], theta[: model.inertial_count])
        known = model.known_torque(di.Motion(*np.zeros((3, 1, model.robot.dof))))[0]
        np.testing.assert_allclose(np.array(gravity, float)[:, 0], still - known, rtol=1e-10, atol=1e-10)
    return found


@pytest.mark.parametrize("joints", [1, 2, 3])
@pytest.mark.parametrize("right", [True, False])
def test_expressions_are_the_kernels(joints: int, right: bool) -> None:
    for seed in range(3 if right else 1):
        robot = random_arm(seed, joints, right=right)
        found = compared(di.DynamicModel(robot, ["viscous"]))
        assert found.weak_terms == 0 or not right


def test_a_follower_a_coupling_and_known_drives() -> None:
    robot = random_arm(7, 3, right=True)
    joints = (*robot.joints[:2], replace(robot.joints[2], kind="revolute", mimic=Mimic("j0", -0.7, 0.3)))
    robot = replace(robot, joints=joints, coupling=None).with_drives(
        {"j0": Drive(50.0, 1e-4, bias=2.0), "j1": Drive(-30.0, 2e-4)}, coupling=[[1.0, 0.0], [0.5, 1.0]]
    )
    assert robot.dof == 2
    found = compared(di.DynamicModel(robot, ["coulomb", "viscous", "rotor_inertia"]))
    assert found.known_torque.has(found.ddq[1]) and found.known_torque.subs(dict.fromkeys(found.ddq, 0)) != 0


@pytest.mark.parametrize("part", FRICTION.names())
def test_friction_parts(part: str) -> None:
    model = di.DynamicModel(random_arm(1, 2, right=True), [part])
    found = di.symbolic_model(model)
    motion = model.random_motion(4, 1)
    columns = model.regressor(motion)[:, :, found.base.independent]
    moving = {"q": found.q, "dq": found.dq, "ddq": found.ddq}
    for row in range(4):
        values = {s: getattr(motion, array)[row, k] for array, own in moving.items() for k, s in enumerate(own)}
        for symbol in found.regressor.free_symbols - set(values):
            state = None if motion.state is None else motion.state[..., 0]
            word, joint = re.fullmatch(r"(load|T|z)(\d)(?:_1)?", symbol.name).groups()  # type: ignore[union-attr]
            signal = {"load": motion.torque, "T": motion.temperature, "z": state}[word]
            assert signal is not None
            values[symbol] = signal[row, int(joint) - 1]
        np.testing.assert_allclose(np.array(found.regressor.subs(values), float), columns[row], rtol=1e-12, atol=1e-12)


def test_a_textbook_arm() -> None:
    """Planar arm of two links in a vertical plane: Siciliano et al. 2009, section 7.3.2, by its own symbols."""
    joints = (
        Joint("a", "revolute", -1, rotation_about(X, np.pi / 2), np.zeros(3), Z),
        Joint("b", "revolute", 0, np.eye(3), np.array([0.5, 0.0, 0.0]), Z),
    )
    robot = Robot("planar", (Link("one"), Link("two")), joints, -9.81 * Z)
    found = di.symbolic_model(robot)
    names = [sympy.sstr(each, full_prec=False) for each in found.combinations]
    assert names[0] == "Izz[one] + 0.25*m[two]"
    by_name = dict(zip(names, found.beta, strict=True))
    (q1, q2), (dq1, dq2), (ddq1, ddq2) = found.q, found.dq, found.ddq
    first, second = by_name["Izz[one] + 0.25*m[two]"], by_name["Izz[two]"]
    mx1, mx2, my2 = by_name["0.5*m[two] + mx[one]"], by_name["mx[two]"], by_name["my[two]"]
    my1 = by_name["my[one]"]
    a, g, half = sympy.Float(0.5), sympy.Float(9.81), q1 + q2
    cosine, sine = mx2 * sympy.cos(q2) - my2 * sympy.sin(q2), mx2 * sympy.sin(q2) + my2 * sympy.cos(q2)
    weight = g * (mx2 * sympy.cos(half) - my2 * sympy.sin(half))
    own = g * (mx1 * sympy.cos(q1) - my1 * sympy.sin(q1))
    expected = [
        (first + second + 2 * a * cosine) * ddq1
        + (second + a * cosine) * ddq2
        - a * sine * (2 * dq1 * dq2 + dq2**2)
        + own
        + weight,
        (second + a * cosine) * ddq1 + second * ddq2 + a * sine * dq1**2 + weight,
    ]
    for one, other in zip(found.torque, expected, strict=True):
        left = sympy.expand(sympy.expand_trig(one - other))
        assert all(abs(factor) < 1e-12 for factor in left.as_coefficients_dict().values()), left
    assert found.gravity.has(sympy.cos(half)) and not found.gravity.has(dq1)
    assert repr(found) == f"<SymbolicModel of planar: 2 joints, {len(names)} base parameters>"


def test_products_where_they_are_shorter() -> None:
    """The third axis crosses the second: the weight turns with cos q2 cos q3, not with cosines of sums."""
    robot = di.read_robot("generic-7r")
    robot = robot.locked(dict.fromkeys(robot.joint_names[3:], 0.0))
    found = compared(di.DynamicModel(robot))
    q2, q3 = found.q[1:]
    assert found.gravity.has(sympy.cos(q2) * sympy.cos(q3)) and not found.gravity.has(sympy.cos(q2 + q3))
    assert not any(atom == 1.0 for atom in found.regressor.atoms(sympy.Float))


def test_rounded_angles_are_told(tmp_path: Path, capsys: Capture) -> None:
    text = URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="3e-6 1 0"/>')
    assert text != URDF
    (tmp_path / "arm.urdf").write_text(text)
    found = compared(di.DynamicModel(di.read_robot(tmp_path / "arm.urdf")))
    assert found.weak_terms > 0
    assert main(["inspect", str(tmp_path / "arm.urdf"), "--symbolic", "gravity"]) == 0
    shown = capsys.readouterr().out
    assert (
        f"{found.weak_terms} terms of Y have a coefficient below 1e-4" in shown and "write it with all digits" in shown
    )


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(URDF)
    return "arm.urdf"


def test_inspect_prints_them(arm: str, capsys: Capture) -> None:
    assert main(["inspect", arm, "--symbolic", "gravity", "regressor"]) == 0
    shown = capsys.readouterr().out
    assert "  elbow: -9.81*beta7*cos(q2) - 9.81*beta8*sin(q2)" in shown.splitlines()
    assert "  Y[1, 6] = ddq1*cos(q2)**2 - dq1*dq2*sin(2*q2)" in shown.splitlines()
    assert "  Y[1, 9] = tanh(100*dq1)" in shown or "  Y[1, 9] = tanh(50*dq1)" in shown
    assert "Y[1, 4]" not in shown  # Iyy of the second link gives no torque of the first
    assert main(["inspect", arm, "--symbolic", "regressor", "--friction", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert set(data["symbolic"]) == {"base_parameters", "regressor", "known_torque"}
    table = data["symbolic"]["regressor"]
    assert len(table) == 2 and len(table[0]) == len(data["base_parameters"]) and table[0][3] == "0"
    assert sympy.sympify(table[0][5]) == sympy.sympify("ddq1*cos(q2)**2 - dq1*dq2*sin(2*q2)")
    assert data["symbolic"]["base_parameters"][0] == "Ixx[fore] + Izz[upper] + 0.16*m[fore]"


def test_inspect_prints_what_is_known(arm: str, capsys: Capture) -> None:
    assert main(["inspect", arm, "--symbolic", "regressor"]) == 0
    assert "of torque = Y beta;" in (shown := capsys.readouterr().out) and "known" not in shown
    Path("arm.xml").write_text(
        '<mujoco><worldbody><body><joint name="a" armature="0.1"/><geom size=".1"/></body></worldbody></mujoco>'
    )
    assert main(["inspect", "arm.xml", "--symbolic", "regressor"]) == 0
    shown = capsys.readouterr().out
    assert "of torque = Y beta + known;" in shown and shown.endswith("  a: 0.1*ddq1\n")


def test_more_joints_are_refused(arm: str, capsys: Capture) -> None:
    assert main(["inspect", "er16", "--symbolic", "gravity"]) == 1
    told = capsys.readouterr().err
    assert "er16 has 6 joints" in told and "lock the others (locked: in the case file" in told and "casadi" in told
    Path("case.yaml").write_text("case: 1\nrobot: er16\nlocked: {joint4: 0, joint5: 0, joint6: 0}\n")
    names = di.read_robot("er16").joint_names
    locked = ", ".join(f"{name}: 0" for name in names[3:])
    Path("case.yaml").write_text(f"case: 1\nrobot: er16\nlocked: {{{locked}}}\n")
    assert main(["inspect", "case.yaml", "--symbolic", "gravity"]) == 0  # as the message says
    assert "sin(q2 + q3)" in capsys.readouterr().out


def test_from_python(arm: str) -> None:
    found = di.symbolic_model(arm)
    assert len(found.beta) == 8 and found.model.friction == ()
    assert len(di.symbolic_model(di.read_case(arm)).beta) == 14
    with pytest.raises(di.BadArgument, match="where a robot is wanted"):
        di.symbolic_model(3)
