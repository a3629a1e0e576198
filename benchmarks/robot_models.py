"""Robot models in URDF or MJCF, read and written back: the regressor beside Pinocchio's or MuJoCo's, and a round trip.

For each URDF below a folder: whether it is read, and why not; the largest difference of the regressor from that of
Pinocchio on 20 random states, each as a share of the largest entry of its column's kind; the URDF with other inertias,
every other byte kept, read again, also by Pinocchio: the largest difference of torques as a share of the largest of the
robot. Joints that follow another move freely in both. Robots that Pinocchio gives a free base have a fixed one here.
With --mjcf the same for each MJCF that MuJoCo loads and that has a joint, beside MuJoCo.
Run: python -m benchmarks.robot_models FOLDER [--mjcf] (the wheel of example-robot-data, unpacked, has 69 URDFs)
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.mujoco_oracle import mujoco_regressor
from dynident.arrays import Array
from dynident.errors import DynidentError
from dynident.exports.models.proving.engines import without_log
from dynident.exports.models.proving.robot_model_proof import reload_mjcf
from dynident.exports.models.subject.drives import drives_of
from dynident.exports.models.subject.identified import OWN, Identified
from dynident.exports.models.subject.source import OwnDescription
from dynident.exports.models.writing.mjcf_own import beside, patched_mjcf
from dynident.exports.models.writing.urdf import written_urdf
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import Inertia
from dynident.model.parameters import from_pinocchio
from dynident.model.robot import Robot
from dynident.robot_files import read_robot
from dynident.robot_files.formats.urdf import read_urdf

STATES = 20

#: Share of the largest entry of all below which the largest of a kind is rounding.
ROUNDING = 1e-12

#: Columns of moments and products of inertia, of mass times centre, of mass; and which of them each column is.
KINDS = (slice(0, 6), slice(6, 9), slice(9, 10))
WHICH = np.array([0] * 6 + [1] * 3 + [2])


@dataclass(frozen=True)
class Outcome:
    """What was found of a robot model: joints, differences; ``why`` says what was not done."""

    joints: int = 0
    regressor: float = float("nan")
    written: float = float("nan")
    why: str = ""


def free(robot: Robot) -> Robot:
    """Return the robot with joints that follow none, and without known rotors."""
    return replace(robot, joints=tuple(replace(joint, mimic=None) for joint in robot.joints), coupling=None)


def pinocchio_states(model: Any, robot: Robot, states: Array) -> Iterator[tuple[list[int], Array, Array, Array]]:
    """Yield, for each of the states (3, samples, n), rows of the joints and positions, velocities, accelerations."""
    number = [model.getJointId(name) for name in robot.joint_names]
    at = [model.joints[k].idx_v for k in number]
    for q, dq, ddq in zip(*states, strict=True):
        place, speed, rate = np.zeros(model.nq), np.zeros(model.nv), np.zeros(model.nv)
        for column, k in enumerate(number):
            joint, angle = model.joints[k], q[column]
            place[joint.idx_q : joint.idx_q + joint.nq] = angle if joint.nq == 1 else (np.cos(angle), np.sin(angle))
        speed[at], rate[at] = dq, ddq
        yield at, place, speed, rate


def beside_pinocchio(robot: Robot, path: Path) -> float:
    """Return the largest difference of the regressor, as a share of the largest entry of its kind of column."""
    import pinocchio  # pyright: ignore[reportMissingImports]

    pin: Any = pinocchio
    model = pin.buildModelFromUrdf(str(path))
    data, count = model.createData(), robot.dof
    states = np.random.default_rng(0).uniform(-1.5, 1.5, (3, STATES, count))
    found = DynamicModel(robot).regressor(*states).reshape(STATES, count, count, 10)
    expected = np.empty_like(found)
    columns = [model.getJointId(name) - 1 for name in robot.joint_names]
    for row, (at, *state) in enumerate(pinocchio_states(model, robot, states)):
        whole = pin.computeJointTorqueRegressor(model, data, *state)
        expected[row] = from_pinocchio(whole[at].reshape(count, -1, 10)[:, columns])
    sizes = np.array([np.abs(expected[..., kind]).max() for kind in KINDS])[WHICH]
    return float((np.abs(found - expected) / np.where(sizes > 0, sizes, 1.0)).max())


def other_bodies(robot: Robot) -> Array:
    """Return consistent inertial parameters of all links, (10 l,): the stated ones times 1.2, else those of a ball.

    Links between two joints of one body have none, and none is put there.
    """
    ball = Inertia.from_centre_of_mass(1.0, np.array([0.05, 0.02, 0.1]), 0.01 * np.eye(3))
    bodies = [
        link.inertia if link.inertia is not None and (link.inertia.mass == 0 or not link.inertia.defect()) else ball
        for link in robot.links
    ]
    return 1.2 * np.concatenate([body.vector for body in bodies])


def after_a_round_trip(robot: Robot, path: Path) -> float:
    """Return the largest difference of torques of the URDF with other inertias, read again here and by Pinocchio."""
    import pinocchio  # pyright: ignore[reportMissingImports]

    pin: Any = pinocchio
    model, theta = DynamicModel(robot), other_bodies(robot)
    estimate: Any = SimpleNamespace(model=model)
    subject = Identified(estimate, theta, OWN, OwnDescription(path, path.read_bytes()))
    data, _ = written_urdf(subject, drives_of(subject), lump=False)
    again = DynamicModel(free(read_urdf(path, data)))
    nominal = again.nominal()
    assert nominal is not None
    states = np.random.default_rng(1).uniform(-1.5, 1.5, (3, STATES, robot.dof))
    expected = model.regressor(*states) @ theta
    engine = pin.buildModelFromXML(data.decode("utf-8"))
    own = engine.createData()
    both = (
        again.regressor(*states) @ nominal,
        np.array([pin.rnea(engine, own, *state)[at] for at, *state in pinocchio_states(engine, robot, states)]),
    )
    return max(float(np.abs(found - expected).max() / np.abs(expected).max()) for found in both)


def beside_mujoco(robot: Robot, path: Path) -> float:
    """Return the same of an MJCF beside MuJoCo; links that are no body of the file have no mass and do not count."""
    q, dq, ddq = np.random.default_rng(0).uniform(-1.5, 1.5, (3, STATES, robot.dof))
    shape = STATES, robot.dof, len(robot.links), 10
    found = DynamicModel(robot).regressor(q, dq, ddq)[..., : 10 * len(robot.links)].reshape(shape)
    expected = mujoco_regressor(path, robot, q, dq, ddq).reshape(shape)
    sizes = np.array([np.nanmax(np.abs(expected[..., kind])) for kind in KINDS])[WHICH]
    sizes = np.where(sizes > ROUNDING * sizes.max(), sizes, sizes.max())  # such as the mass on a pendulum: none
    return float(np.nanmax(np.abs(found - expected) / sizes))


def mjcf_after_a_round_trip(robot: Robot, path: Path) -> float:
    """Return the same of an MJCF, read again by dynident and by MuJoCo, whichever differs more."""
    model, theta = DynamicModel(robot), other_bodies(robot)
    estimate: Any = SimpleNamespace(model=model)
    source = OwnDescription(path, path.read_bytes())
    subject = Identified(estimate, theta, OWN, source)
    patched = patched_mjcf(subject, drives_of(subject), source, lump=False, output=path)
    with tempfile.TemporaryDirectory() as folder:
        found = list(reload_mjcf(subject, source, patched, beside(path, source, patched), Path(folder)))
    for one in found:
        if one.why_not:
            raise ValueError(f"{one.engine}: {one.why_not}")
    pairs = [(np.asarray(one.torque), np.asarray(one.expected)) for one in found]
    return max(float(np.abs(torque - wanted).max() / np.abs(wanted).max()) for torque, wanted in pairs)


def mjcf_files(folder: Path) -> list[Path]:
    """Return the models that MuJoCo loads below a folder and that have a joint; parts of others are left out."""
    import mujoco

    api: Any = mujoco
    found = []
    for path in sorted(folder.rglob("*.xml")):
        if b"<mujoco" not in path.read_bytes()[:4000]:
            continue
        with contextlib.suppress(ValueError), without_log():
            model = api.MjModel.from_xml_path(str(path))
            if model.njnt:
                found.append(path)
    return found


def outcome_of(path: Path) -> Outcome:
    """Return what was found of a robot model."""
    try:
        robot = read_robot(path)
    except DynidentError as problem:
        return Outcome(why=f"not read: {str(problem).removeprefix(str(path)).lstrip(': ')}")
    is_urdf = path.suffix == ".urdf"
    plain = free(robot) if is_urdf else robot
    beside_engine = beside_pinocchio if is_urdf else beside_mujoco
    back = after_a_round_trip if is_urdf else mjcf_after_a_round_trip
    regressor = float("nan")
    try:
        regressor = beside_engine(plain, path)
        return Outcome(plain.dof, regressor, back(plain, path))
    except (DynidentError, ValueError, IndexError) as problem:
        return Outcome(plain.dof, regressor, why=" ".join(str(problem).split()))


def main() -> None:
    """Print a table of all robot models below a folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--mjcf", action="store_true", help="MJCF beside MuJoCo in place of URDF beside Pinocchio")
    options = parser.parse_args()
    files = mjcf_files(options.folder) if options.mjcf else sorted(options.folder.rglob("*.urdf"))
    print("| robot model | joints | regressor | written back |\n|---|---|---|---|")
    outcomes = []
    for path in files:
        with without_log() if options.mjcf else contextlib.nullcontext():
            outcome = outcome_of(path)
        outcomes.append(outcome)
        name = path.relative_to(options.folder)
        print(f"| {name} | {outcome.joints} | {outcome.regressor:.1e} | {outcome.written:.1e} | {outcome.why}")
        sys.stdout.flush()
    done = [outcome for outcome in outcomes if outcome.joints and not outcome.why]
    regressor, written = (max((getattr(o, name) for o in done), default=0.0) for name in ("regressor", "written"))
    print(f"\n{len(done)} of {len(files)}: regressor {regressor:.1e}, written back {written:.1e}")


if __name__ == "__main__":
    main()
