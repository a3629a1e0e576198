"""What a call from Python is given as a robot: a file or a name, a value of this library, of Pinocchio or of MuJoCo."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.errors import BadArgument
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, Joint, JointLimits, Mimic
from dynident.model.robot import Frame, Link, Robot
from dynident.robot_files import read_robot

#: A robot: a value, a file or a name, a ``pinocchio.Model``, a ``mujoco.MjModel`` or ``MjSpec``.
RobotLike: TypeAlias = Any

#: From here on a limit stands for none.
_NO_LIMIT = 1e20


def robot_of(subject: RobotLike) -> Robot:
    """Return a robot from a file, a name, or a model of Pinocchio or MuJoCo.

    Of a ``pinocchio.Model`` and a ``mujoco.MjModel`` are read: the tree of joints with one degree of freedom, inertias,
    gravity, limits, armature (as known rotor inertia), damping and Coulomb friction, named frames, and joints that
    follow another one (mimic of Pinocchio, the linear equality of two joints of MuJoCo). Shapes are not read. ``note``
    of the robot names what has a torque in MuJoCo and none here: springs, gravity compensation, tendons, fluids,
    damping of higher order.

    Args:
        subject: A file or a name as :func:`read_robot` takes it, a ``pinocchio.Model``, its ``RobotWrapper``, a
            ``mujoco.MjModel`` or ``mujoco.MjSpec``, a :class:`DynamicModel`; a :class:`Robot` as it is.

    Raises:
        BadArgument: Something else, or a model with other joints, with loops, muscles or flexible bodies.
        FileError: No such file or name.
        DescriptionError: A fault in a file.
    """
    if isinstance(subject, Robot):
        return subject
    if isinstance(subject, DynamicModel):
        return subject.robot
    if isinstance(subject, str | Path):
        if "<" in str(subject):
            raise BadArgument("robot", "the text of a robot model where its file is wanted", "write it to a file")
        return read_robot(subject)
    reader = _READERS.get((type(subject).__module__.partition(".")[0], type(subject).__name__))
    if reader is None:
        step = "give a URDF file, a name, a Robot, a pinocchio.Model or a mujoco.MjModel"
        raise BadArgument("robot", f"{type(subject).__name__} where a robot is wanted", step)
    return reader(subject)


def is_robot_model(subject: Any) -> bool:
    """Return whether a value is a robot model of Pinocchio or MuJoCo."""
    return (type(subject).__module__.partition(".")[0], type(subject).__name__) in _READERS


@dataclass
class _Parts:
    """Links, joints and frames as they are read, and where each body of the source is: link, rotation, translation."""

    inertias: list[Inertia] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    fixed: list[list[str]] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)
    frames: dict[str, Frame] = field(default_factory=dict)

    def add(self, name: str, inertia: Inertia, joint: Joint) -> int:
        """Add a link with the joint that moves it, and return its number."""
        self.names.append(name)
        self.inertias.append(inertia)
        self.fixed.append([])
        self.joints.append(joint)
        return len(self.names) - 1

    def robot(self, name: str, base: str, gravity: npt.ArrayLike, note: str) -> Robot:
        """Return the robot.

        Raises:
            BadArgument: No joint.
        """
        if not self.joints:
            raise BadArgument("robot", "a model without moving joints", "give the model of an arm")
        found = zip(self.names, self.inertias, self.fixed, strict=True)
        links = tuple(Link(link, inertia, tuple(fixed)) for link, inertia, fixed in found)
        frames = {key: frame for key, frame in self.frames.items() if key not in self.names}
        joints = tuple(self.joints)
        return Robot(name or "robot", links, joints, np.array(gravity), base=base, frames=frames, note=note)


def _from_pinocchio(model: Any) -> Robot:
    import pinocchio  # pyright: ignore[reportMissingImports]

    pin: Any = pinocchio
    parts, base = _Parts(), "universe"
    bodies: dict[int, str] = {}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY:
            bodies.setdefault(int(frame.parentJoint), frame.name)
    leaders = dict(zip(map(int, model.mimicking_joints), map(int, model.mimicked_joints), strict=True))
    for number in range(1, model.njoints):
        body = model.inertias[number]
        inertia = Inertia.from_centre_of_mass(body.mass, body.lever, body.inertia)
        parts.add(bodies.get(number, str(model.names[number])), inertia, _pinocchio_joint(pin, model, number, leaders))
    for frame in model.frames:
        if frame.type != pin.FrameType.JOINT and frame.name != base:
            place = frame.placement
            parts.frames[frame.name] = Frame(int(frame.parentJoint) - 1, place.rotation, place.translation)
    base = bodies.get(0, base)
    parts.frames.pop(base, None)
    return parts.robot(model.name, base, model.gravity.linear, "read from a model of Pinocchio")


def _pinocchio_joint(pin: Any, model: Any, number: int, leaders: Mapping[int, int]) -> Joint:
    """Return a joint; one that follows another (JointModelMimic) has no limits, drive and friction of its own.

    Raises:
        BadArgument: A joint of another kind, by its name.
    """
    joint, name, place = model.joints[number], str(model.names[number]), model.jointPlacements[number]
    kind, at = joint.shortname(), joint.idx_v
    free = joint.nv if number not in leaders else 1
    if kind == "JointModelComposite" or free != 1:
        evidence = f"joint '{name}' is a {kind} with {free} degree{'s' * (free != 1)} of freedom"
        step = (
            "add its joints to the model one by one, each with a body"
            if kind == "JointModelComposite"
            else "build the model on a fixed base, with revolute and prismatic joints"
        )
        raise BadArgument("robot", evidence, step)
    follow = None
    if number in leaders:
        own = joint.extract()
        follow = Mimic(str(model.names[leaders[number]]), float(own.scaling), float(own.offset))
    turn, slide = _unit_motion(pin, model, number, leaders.get(number, number), follow)
    if min(np.linalg.norm(turn), np.linalg.norm(slide)) > 1e-9:
        step = "build the model with revolute and prismatic joints"
        raise BadArgument("robot", f"joint '{name}' is a {kind}, which turns and slides at once", step)
    is_hinge = np.linalg.norm(turn) > np.linalg.norm(slide)
    hinge: Literal["revolute", "prismatic"] = "revolute" if is_hinge else "prismatic"
    axis = turn if is_hinge else slide
    if follow is not None:
        return Joint(name, hinge, int(model.parents[number]) - 1, place.rotation, place.translation, axis, mimic=follow)
    bounded = joint.nq == 1
    limits = JointLimits(
        lower=_bound(model.lowerPositionLimit[joint.idx_q], -np.inf) if bounded else -np.inf,
        upper=_bound(model.upperPositionLimit[joint.idx_q]) if bounded else np.inf,
        velocity=_bound(model.velocityLimit[at]),
        effort=_bound(model.effortLimit[at]),
    )
    return Joint(
        name, hinge, int(model.parents[number]) - 1, place.rotation, place.translation, axis, limits,
        Drive(rotor_inertia=float(model.armature[at])),
        damping=float(model.damping[at]),
        friction=float(model.friction[at]),
    )  # fmt: skip


def _unit_motion(pin: Any, model: Any, number: int, moved: int, follow: Mimic | None) -> tuple[Array, Array]:
    """Return how a joint turns and slides over its first unit, each (3,): the logarithm of its pose at position 1.

    Args:
        pin: The module pinocchio.
        model: Its model.
        number: The joint.
        moved: The joint that is moved: itself, or its leader.
        follow: How it follows its leader, or None.
    """
    data, ahead = model.createData(), np.zeros(model.nv)
    ahead[model.joints[moved].idx_v] = 1.0 if follow is None else (1.0 - follow.offset) / follow.multiplier
    pin.forwardKinematics(model, data, pin.integrate(model, pin.neutral(model), ahead))
    motion = pin.log6(model.jointPlacements[number].actInv(data.liMi[number]))
    return np.array(motion.angular), np.array(motion.linear)


def _bound(value: float, none: float = np.inf) -> float:
    return float(value) if abs(value) < _NO_LIMIT else none


def _from_mujoco(model: Any) -> Robot:
    from dynident.api.given_mujoco import robot_of_mujoco  # few need it

    return robot_of_mujoco(model)


#: Readers by package and class of what they read.
_READERS: dict[tuple[str, str], Callable[[Any], Robot]] = {
    ("pinocchio", "Model"): _from_pinocchio,
    ("pinocchio", "RobotWrapper"): lambda wrapper: _from_pinocchio(wrapper.model),
    ("mujoco", "MjModel"): _from_mujoco,
    ("mujoco", "MjSpec"): lambda spec: _from_mujoco(spec.compile()),
}
