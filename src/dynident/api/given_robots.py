"""What a call from Python is given as a robot: a file or a name, a value of this library, of Pinocchio or of MuJoCo."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.errors import BadArgument
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import Inertia
from dynident.model.robot import Drive, Frame, Joint, JointLimits, Link, Mimic, Robot, rotation_about
from dynident.robot_files import read_robot
from dynident.robot_files.rotations import rotation_from_quaternion

#: A robot: a value, a file or a name, a ``pinocchio.Model``, a ``mujoco.MjModel`` or ``MjSpec``.
RobotLike: TypeAlias = Any

#: Types of joints and of equality constraints of MuJoCo (mjtJoint, mjtEq).
_SLIDE, _HINGE, _EQUALITY_OF_JOINTS = 2, 3, 2
_ON_JOINT = 1  # and below: transmissions that turn or slide a joint

#: Muscles of MuJoCo: their activation (mjtDyn) and their gain (mjtGain).
_MUSCLE, _MUSCLE_GAIN = 4, 2

#: From here on a limit stands for none.
_NO_LIMIT = 1e20


def robot_of(subject: RobotLike) -> Robot:
    """Return a robot from a file, a name, or a model of Pinocchio or MuJoCo.

    Of a ``pinocchio.Model`` and a ``mujoco.MjModel`` are read: the tree of joints with one degree of freedom, inertias,
    gravity, limits, armature (as known rotor inertia), damping and Coulomb friction, named frames, and joints that
    follow another one (mimic of Pinocchio, the linear equality of two joints of MuJoCo). Shapes are not read. ``note``
    of the robot names what has a torque in MuJoCo and none here: springs, gravity compensation, tendons, fluids.

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


def _from_mujoco(model: Any) -> Robot:
    _check_bodies(model)
    parts = _Parts()
    places: list[tuple[int, Array, Array]] = [(-1, np.eye(3), np.zeros(3))]  # of each body
    for number in range(1, model.nbody):
        places.append(_add_body(model, number, places[model.body_parentid[number]], parts))
    for number in range(model.nsite):
        link, turn, shift = places[model.site_bodyid[number]]
        rotation, translation = _rotation(model.site_quat[number]), model.site_pos[number]
        name = model.site(number).name or f"site{number}"
        parts.frames.setdefault(name, Frame(link, turn @ rotation, shift + turn @ translation))
    _tie(model, parts)
    name = bytes(model.names).split(b"\0", 1)[0].decode("utf-8", "replace")
    return parts.robot(name, model.body(0).name or "world", model.opt.gravity, _note(model))


def _check_bodies(model: Any) -> None:
    """Refuse what moves a model beside its joints.

    Raises:
        BadArgument: A muscle, or a flexible body.
    """
    for number in range(model.nu):
        if model.actuator_dyntype[number] == _MUSCLE or model.actuator_gaintype[number] == _MUSCLE_GAIN:
            name = model.actuator(number).name or f"number {number}"
            evidence = f"the actuator {name} is a muscle, whose force depends on its length and speed"
            raise BadArgument("robot", evidence, "replace muscles by motors: torques of joints are identified")
    if model.nflex:
        evidence = f"{model.nflex} flexible bodies (flex)"
        raise BadArgument("robot", evidence, "remove them from the model: links are rigid")


def _add_body(model: Any, number: int, carrier: tuple[int, Array, Array], parts: _Parts) -> tuple[int, Array, Array]:
    """Add the links of the joints of a body, and return where the body is; one without joints joins its carrier."""
    link, turn, shift = carrier
    name = model.body(number).name or f"body{number}"
    rotation, translation = turn @ _rotation(model.body_quat[number]), shift + turn @ model.body_pos[number]
    first, count = int(model.body_jntadr[number]), int(model.body_jntnum[number])
    own = _rotation(model.body_iquat[number])
    tensor = own @ np.diag(model.body_inertia[number]) @ own.T
    inertia = Inertia.from_centre_of_mass(model.body_mass[number], model.body_ipos[number], tensor)
    if not count:
        parts.frames[name] = Frame(link, rotation, translation)
        if link >= 0:
            parts.inertias[link] = parts.inertias[link] + inertia.moved(rotation, translation)
            parts.fixed[link].append(name)
        return link, rotation, translation
    at = np.zeros(3)  # origin of the link frame in the frame of the body, which the joints of the body turn with
    for joint in range(first, first + count):
        anchor = np.array(model.jnt_pos[joint])
        moved = _joint(model, joint, link, rotation, translation + rotation @ (anchor - at))
        is_last = joint == first + count - 1
        zero = Inertia.from_centre_of_mass(0.0, np.zeros(3), np.zeros((3, 3)))
        label = name if is_last else f"{name} before {model.joint(joint + 1).name or f'joint{joint + 2}'}"
        link = parts.add(label, inertia.moved(np.eye(3), -anchor) if is_last else zero, moved)
        rotation, translation, at = np.eye(3), np.zeros(3), anchor
    return link, np.eye(3), -at


def _joint(model: Any, number: int, parent: int, rotation: Array, translation: Array) -> Joint:
    name = model.joint(number).name or f"joint{number + 1}"
    if model.jnt_type[number] not in (_SLIDE, _HINGE):
        evidence = f"joint '{name}' has more than one degree of freedom"
        raise BadArgument("robot", evidence, "give the model of an arm on a fixed base, with hinge and slide joints")
    dof, axis = int(model.jnt_dofadr[number]), np.array(model.jnt_axis[number])
    zero = float(model.qpos0[model.jnt_qposadr[number]])  # the position at which the bodies are placed as written
    is_hinge = model.jnt_type[number] == _HINGE
    if is_hinge:
        rotation = rotation @ rotation_about(axis, -zero)
    else:
        translation = translation - zero * rotation @ axis
    lower, upper = model.jnt_range[number] if model.jnt_limited[number] else (-np.inf, np.inf)
    rotor, damping, effort = _actuators(model, number)
    return Joint(
        name,
        "revolute" if is_hinge else "prismatic",
        parent,
        rotation,
        translation,
        axis,
        JointLimits(lower=float(lower), upper=float(upper), effort=effort),
        Drive(rotor_inertia=float(model.dof_armature[dof] + rotor)),
        damping=float(model.dof_damping[dof] + damping),
        friction=float(model.dof_frictionloss[dof]),
    )


def _actuators(model: Any, number: int) -> tuple[float, float, float]:
    """Return rotor inertia, damping and largest torque that the actuators of a joint give it."""
    on_joint = (model.actuator_trntype <= _ON_JOINT) & (model.actuator_trnid[:, 0] == number)
    motors = np.flatnonzero(on_joint & (model.actuator_gear[:, 0] != 0.0))
    gears = np.abs(model.actuator_gear[motors, 0])
    forces = np.where(
        model.actuator_forcelimited[motors], np.abs(model.actuator_forcerange[motors]).max(axis=1), np.inf
    )
    effort = float(gears @ forces) if len(motors) else np.inf
    if model.jnt_actfrclimited[number]:
        effort = min(effort, float(np.abs(model.jnt_actfrcrange[number]).max()))
    if not hasattr(model, "actuator_armature"):  # before MuJoCo 4
        return 0.0, 0.0, effort
    rotor, damping = gears**2 @ model.actuator_armature[motors], gears**2 @ model.actuator_damping[motors]
    return float(rotor), float(damping), effort


def _tie(model: Any, parts: _Parts) -> None:
    """Let joints follow others as equality constraints of joints say.

    Raises:
        BadArgument: Another equality constraint, which closes a loop, or one that ties a joint to one that follows.
    """
    led: set[int] = set()
    tied: set[int] = set()
    for number in np.flatnonzero(model.eq_active0):
        one, other = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        constant, slope, *rest = (float(value) for value in model.eq_data[number][:5])
        led.add(other)
        tied.add(one)
        if model.eq_type[number] != _EQUALITY_OF_JOINTS or other < 0 or any(rest) or led & tied:
            name = model.equality(int(number)).name or f"number {number}"
            evidence = f"the equality constraint {name} is no linear one of a joint and a joint that moves on its own"
            raise BadArgument("robot", evidence, "remove it from the model: loops of bodies are not read")
        zero, leader = (float(model.qpos0[model.jnt_qposadr[joint]]) for joint in (one, other))
        follow = Mimic(parts.joints[other].name, slope, zero + constant - slope * leader)
        parts.joints[one] = replace(parts.joints[one], mimic=follow)


def _note(model: Any) -> str:
    """Return where the robot is from, with what has a torque in MuJoCo and none here."""
    without = {
        "springs of joints": np.any(model.jnt_stiffness),
        "gravity compensation of bodies": np.any(model.body_gravcomp),
        "tendons": model.ntendon > 0,
        "a fluid": model.opt.density > 0 or model.opt.viscosity > 0,
    }
    left = [what for what, is_there in without.items() if is_there]
    return "read from a model of MuJoCo" + (f"; without {', '.join(left)}" if left else "")


def _rotation(quaternion: Array) -> Array:
    """Return the rotation of a quaternion (w, x, y, z) of any length, shape (3, 3)."""
    return rotation_from_quaternion(quaternion / np.linalg.norm(quaternion))


def _bound(value: float, none: float = np.inf) -> float:
    return float(value) if abs(value) < _NO_LIMIT else none


#: Readers by package and class of what they read.
_READERS: dict[tuple[str, str], Callable[[Any], Robot]] = {
    ("pinocchio", "Model"): _from_pinocchio,
    ("pinocchio", "RobotWrapper"): lambda wrapper: _from_pinocchio(wrapper.model),
    ("mujoco", "MjModel"): _from_mujoco,
    ("mujoco", "MjSpec"): lambda spec: _from_mujoco(spec.compile()),
}
