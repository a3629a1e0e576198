"""The regressor of a UR10: its base columns in chunks that stay in the cache, as identification streams them.

Beside it: loops over the samples in Pinocchio, in the layout and code path of FIGAROH, in iDynTree, and MuJoCo's
inverse dynamics (it has no regressor). The bodies are our own; times do not depend on them.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.speed.arms import as_pinocchio, motion, pinocchio_columns, ur10
from benchmarks.speed.harness import Line, Record
from dynident.arrays import Array
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.kernels import batched
from dynident.model.kernels.inputs import VARIABLE
from dynident.model.kernels.joint_columns import JointColumns
from dynident.model.robot import Robot

SAMPLES, CHUNK, REPEATS = 25_000, 1000, 9
STREAMED, TORQUE = "base columns, generated, streamed", "inverse dynamics, generated"


def measure() -> Record:
    found = Record("regressor", f"UR10, {SAMPLES} samples, bodies of our own; per sample")
    robot, states = ur10(), motion(SAMPLES)
    model = DynamicModel(robot, ())
    theta = model.nominal()
    assert theta is not None
    columns = JointColumns(robot.chain, base_parameters(model, inertial_only=True).independent)
    parts = [states.rows(slice(start, start + CHUNK)) for start in range(0, SAMPLES, CHUNK)]
    buffers, spare = columns.buffers(CHUNK), columns.buffers(CHUNK)
    weights = tuple(np.ones_like(block) for block in buffers)

    def stream(some: list[Motion], into: tuple[Array, ...]) -> None:
        for part in some:
            columns.evaluate(part.q, part.dq, part.ddq, out=into)

    def generic() -> None:
        with patch.dict(os.environ, {VARIABLE: "generic"}):
            stream(parts, buffers)

    def halves() -> None:
        half = len(parts) // 2
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(stream, [parts[:half], parts[half:]], [buffers, spare]))

    ours: dict[str, Callable[[], object]] = {
        STREAMED: lambda: stream(parts, buffers),
        "base columns, 2 threads": halves,
        "base columns, generic, streamed": generic,
        "all 60 columns, one new array": lambda: batched.torque_regressor(robot.chain, states.q, states.dq, states.ddq),
        "derivative of the base columns": lambda: [columns.pullback(p.q, p.dq, p.ddq, weights) for p in parts],
        TORQUE: lambda: batched.inverse_dynamics(robot.chain, theta, states.q, states.dq, states.ddq),
    }
    with patch.dict(os.environ, {VARIABLE: "generated"}):
        peers = _peers(found, robot, model, columns, states)
        found.time(ours | peers, REPEATS)
    found.facts |= {"base columns": len(columns.wanted), "entries": sum(map(len, columns.columns))}
    found.lines = _lines()
    return found


def _lines() -> list[Line]:
    loop, per = "Pinocchio, Python loop, stored", SAMPLES
    return [
        Line("regressor, 36 base columns of a UR10, per sample", STREAMED, loop, 20.0, per),
        Line("the same beside FIGAROH's layout", STREAMED, "Pinocchio, loop and row copy of FIGAROH", None, per),
        Line("the same beside iDynTree", STREAMED, "iDynTree, Python loop, stored", None, per),
        Line("the same, 2 threads", "base columns, 2 threads", loop, None, per, "wall"),
        Line("the same by the generic kernel", "base columns, generic, streamed", loop, None, per),
        Line("all 60 columns into one new array", "all 60 columns, one new array", loop, None, per),
        Line("derivative of the base columns (reverse mode)", "derivative of the base columns", loop, None, per),
        Line("inverse dynamics", TORQUE, "Pinocchio rnea, Python loop, stored", None, per),
        Line("inverse dynamics beside MuJoCo", TORQUE, "MuJoCo mj_inverse, Python loop, stored", None, per),
    ]


def _peers(
    found: Record, robot: Robot, model: DynamicModel, columns: JointColumns, states: Motion
) -> dict[str, Callable[[], object]]:
    """Return the loops of the peers that are there, each checked against ours."""
    q, dq, ddq = states.q, states.dq, states.ddq
    theta = model.nominal()
    assert theta is not None
    own_torque = batched.inverse_dynamics(robot.chain, theta, q, dq, ddq)
    torque, calls = np.empty_like(q), {}
    if pinocchio := found.peer("pinocchio", "pin"):
        oracle = as_pinocchio(robot)
        data, rows, flat = oracle.createData(), np.empty((SAMPLES, 6, 60)), np.empty((6 * SAMPLES, 60))

        def loop() -> None:
            for k in range(SAMPLES):
                rows[k] = pinocchio.computeJointTorqueRegressor(oracle, data, q[k], dq[k], ddq[k])

        def copied() -> None:
            for k in range(SAMPLES):
                whole = pinocchio.computeJointTorqueRegressor(oracle, data, q[k], dq[k], ddq[k])
                for joint in range(6):
                    flat[joint * SAMPLES + k, :] = whole[joint, :]

        def rnea() -> None:
            for k in range(SAMPLES):
                torque[k] = pinocchio.rnea(oracle, data, q[k], dq[k], ddq[k])

        loop()
        places = pinocchio_columns(columns.wanted)
        blocks = zip(columns.columns, columns.evaluate(q, dq, ddq), strict=True)
        apart = max(np.abs(rows[:, j, places[own]].T - block).max() for j, (own, block) in enumerate(blocks))
        found.agree("entries, of the largest, Pinocchio", apart / np.abs(rows).max(), 1e-12)
        rnea()
        found.agree("torques, of the largest, Pinocchio", _apart(torque, own_torque), 1e-12)
        calls |= {"Pinocchio, Python loop, stored": loop, "Pinocchio, loop and row copy of FIGAROH": copied}
        calls["Pinocchio rnea, Python loop, stored"] = rnea
    if mujoco := found.peer("mujoco"):
        plant = mujoco.MjModel.from_xml_string(_mjcf(robot))
        state, other = mujoco.MjData(plant), np.empty_like(q)

        def inverse() -> None:
            for k in range(SAMPLES):
                state.qpos[:], state.qvel[:], state.qacc[:] = q[k], dq[k], ddq[k]
                mujoco.mj_inverse(plant, state)
                other[k] = state.qfrc_inverse

        inverse()
        found.agree("torques, of the largest, MuJoCo", _apart(other, own_torque), 1e-9)
        calls["MuJoCo mj_inverse, Python loop, stored"] = inverse
    if idyntree := found.peer("idyntree.bindings", "idyntree"):
        calls["iDynTree, Python loop, stored"] = _idyntree(found, idyntree, robot, states, own_torque)
    return calls


def _apart(theirs: Array, ours: Array) -> float:
    return float(np.abs(theirs - ours).max() / np.abs(ours).max())


def _mjcf(robot: Robot) -> str:
    from dynident.model.parameters import to_mujoco_fullinertia

    def numbers(values: object) -> str:
        return " ".join(repr(float(value)) for value in np.ravel(np.asarray(values)))

    body, end = "", ""
    for link, joint in zip(robot.links, robot.joints, strict=True):
        own, turn = link.inertia, np.asarray(joint.rotation)
        inertia = [own.about_centre[i, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
        body += (
            f'<body pos="{numbers(joint.translation)}" xyaxes="{numbers([turn[:, 0], turn[:, 1]])}">'
            f'<joint axis="{numbers(joint.axis)}"/><inertial mass="{own.mass!r}" pos="{numbers(own.centre_of_mass)}" '
            f'fullinertia="{numbers(to_mujoco_fullinertia(np.array(inertia)))}"/>'
        )
        end += "</body>"
    return (
        f'<mujoco><compiler angle="radian"/><option gravity="{numbers(robot.gravity)}">'
        f'<flag contact="disable"/></option><worldbody>{body}{end}</worldbody></mujoco>'
    )


def _idyntree(found: Record, idyntree: Any, robot: Robot, states: Motion, torque: Array) -> Callable[[], object]:
    """Return a loop over iDynTree's regressor of the inverse dynamics, whose first six rows are of the base."""
    i = idyntree
    model = i.Model()
    base = i.Link()
    model.addLink("base", base)
    for k, (link, joint) in enumerate(zip(robot.links, robot.joints, strict=True)):
        own = link.inertia
        centre = i.Position(*map(float, own.centre_of_mass))
        about = i.RotationalInertia()
        for r in range(3):
            for c in range(3):
                about.setVal(r, c, float(own.about_centre[r, c]))
        inertia = i.SpatialInertia()
        inertia.fromRotationalInertiaWrtCenterOfMass(float(own.mass), centre, about)
        part = i.Link()
        part.setInertia(inertia)
        turning = i.RevoluteJoint()
        turn = i.Rotation(*map(float, np.asarray(joint.rotation).ravel()))
        place = i.Position(*map(float, joint.translation))
        turning.setRestTransform(i.Transform(turn, place))
        axis = i.Axis(i.Direction(*map(float, joint.axis)), i.Position(0.0, 0.0, 0.0))
        parent = "base" if k == 0 else robot.links[k - 1].name
        turning.setAttachedLinks(model.getLinkIndex(parent), model.getNrOfLinks())
        turning.setAxis(axis, model.getNrOfLinks(), model.getLinkIndex(parent))
        model.addJointAndLink(parent, joint.name, turning, link.name, part)
    dynamics = i.KinDynComputations()
    if not dynamics.loadRobotModel(model):
        raise SystemExit("iDynTree refuses the model")
    dynamics.setFrameVelocityRepresentation(i.MIXED_REPRESENTATION)
    out = i.MatrixDynSize(12, 70)
    out.zero()  # it leaves entries as they are that are zero at every motion
    rows = np.empty((SAMPLES, 6, 70))
    pose, twist, still = np.eye(4), np.zeros(6), np.zeros(6)
    gravity = np.asarray(robot.gravity)

    def loop() -> None:
        for k in range(SAMPLES):
            dynamics.setRobotState(pose, states.q[k], twist, states.dq[k], gravity)
            dynamics.inverseDynamicsInertialParametersRegressor(still, states.ddq[k], out)
            rows[k] = out.toNumPy()[6:]

    loop()
    values = i.VectorDynSize(70)
    model.getInertialParameters(values)
    found.agree("torques, of the largest, iDynTree", _apart(rows @ values.toNumPy(), torque), 1e-9)
    return loop
