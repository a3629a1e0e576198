"""The robot of a ``mujoco.MjModel``: the tree of its bodies, joints that follow others or are held still, gravity."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadArgument, DescriptionError
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, JointLimits, Mimic, rotation_about
from dynident.model.robot import Frame, Robot
from dynident.robot_files.leaders import carried_by_leaders, led_by_drives
from dynident.robot_files.mjcf.bodies import FLOATING
from dynident.robot_files.rotations import rotation_from_quaternion
from dynident.robot_files.tree import Connection, assemble, between_joints, numbered, ring, tied_by_lengths, with_held

#: Types of joints and of equality constraints of MuJoCo (mjtJoint, mjtEq).
_FREE, _SLIDE, _HINGE = 0, 2, 3
_LOOPS, _EQUALITY_OF_JOINTS, _EQUALITY_OF_TENDONS = (0, 1), 2, 3
_BODY, _WRAP_JOINT = 1, 1
_ON_JOINT = 1  # and below: transmissions that turn or slide a joint

#: Muscles of MuJoCo: their activation (mjtDyn) and their gain (mjtGain).
_MUSCLE, _MUSCLE_GAIN = 4, 2


@dataclass
class _MujocoParts:
    """What is read of the bodies.

    Attributes:
        names: Name of each body.
        inertias: Inertia by name, about the origin of the link; of bodies between two joints too.
        origins: Origin of each body's own frame in the frame of its link, shape (3,), in m.
        joints: The joint that moves each link, and how bodies without joints are fixed.
        moving: Name of each joint of the model.
    """

    names: list[str]
    moving: list[str]
    inertias: dict[str, Inertia | None] = field(default_factory=dict)
    origins: list[Array] = field(default_factory=lambda: [np.zeros(3)])
    joints: dict[str, Connection] = field(default_factory=dict)


def robot_of_mujoco(model: Any) -> Robot:
    """Return the robot of a ``mujoco.MjModel``.

    Raises:
        BadArgument: Ball joints, loops, equalities that are not linear or redundant, muscles, flexible bodies, or no
            joint that moves.
    """
    import mujoco  # pyright: ignore[reportMissingImports]

    package: Any = mujoco
    off = _switched_off(model, package.mjtDisableBit)
    _check_bodies(model)
    bodies = _MujocoParts(_names(model, "body", model.nbody), _names(model, "joint", model.njnt, 1))
    base = model.body(0).name or "world"
    bodies.names[0] = base
    bodies.inertias[base] = None
    for number in range(1, model.nbody):
        _add_body(model, number, bodies)
    if "equality" not in off:
        _tie(model, bodies)
    if all(joint.kind == "fixed" for joint in bodies.joints.values()):
        raise BadArgument("robot", "a model without moving joints", "give the model of an arm")
    name = bytes(model.names).split(b"\0", 1)[0].decode("utf-8", "replace") or "robot"
    try:
        found = assemble("robot", name, bodies.inertias, list(bodies.joints.values()), _note(model, off))
    except DescriptionError as error:
        raise BadArgument("robot", ": ".join(filter(None, (error.where, error.evidence))), error.step) from error
    links = {base: Frame(-1, np.eye(3), np.zeros(3))}
    links |= {link.name: Frame(i, np.eye(3), np.zeros(3)) for i, link in enumerate(found.links)} | dict(found.frames)
    frames = dict(found.frames)
    for number in range(model.nsite):
        body = int(model.site_bodyid[number])
        link, own = links[bodies.names[body]], bodies.origins[body] + model.site_pos[number]
        rotation = link.rotation @ _rotation(model.site_quat[number])
        frame = Frame(link.link, rotation, link.translation + link.rotation @ own)
        site = model.site(number).name or f"site{number}"
        if site not in links:
            frames.setdefault(site, frame)
    gravity = np.zeros(3) if "gravity" in off else np.array(model.opt.gravity)
    damped, rubs = "damper" not in off, "frictionloss" not in off
    driven = [joint for number, joint in enumerate(bodies.moving) if _motors(model, number)]
    joints = tuple(
        replace(joint, damping=joint.damping if damped else 0.0, friction=joint.friction if rubs else 0.0)
        for joint in carried_by_leaders(led_by_drives(found, driven).joints)
    )
    return replace(found, gravity=gravity, frames=frames, joints=joints)


def _switched_off(model: Any, bits: Any) -> set[str]:
    """Return what flags of the model switch off, of what has a part in torques."""
    parts = {"constraint": ("equality", "frictionloss"), "passive": ("spring", "damper")}  # passive: before 3.3
    names = (*parts, "equality", "frictionloss", "spring", "damper", "gravity")
    found = {name for name in names if model.opt.disableflags & int(getattr(bits, f"mjDSBL_{name.upper()}", 0))}
    return found.union(*(parts.get(name, ()) for name in found))


def _names(model: Any, kind: Literal["body", "joint"], size: int, first: int = 0) -> list[str]:
    """Return the names of bodies or joints; those without one get a number that no other has."""
    given = [str(getattr(model, kind)(number).name) for number in range(size)]
    found: list[str] = []
    for number, name in enumerate(given):
        found.append(name or numbered(kind, number + first, {*given, *found}))
    return found


def _check_bodies(model: Any) -> None:
    """Refuse what moves a model beside its joints.

    Raises:
        BadArgument: A muscle, or a flexible body.
    """
    for number in range(len(model.actuator_dyntype)):  # a pid has several controls
        if model.actuator_dyntype[number] == _MUSCLE or model.actuator_gaintype[number] == _MUSCLE_GAIN:
            name = model.actuator(number).name or f"number {number}"
            evidence = f"the actuator {name} is a muscle, whose force depends on its length and speed"
            raise BadArgument("robot", evidence, "replace muscles by motors: torques of joints are identified")
    if model.nflex:
        evidence = f"{model.nflex} flexible bodies (flex)"
        raise BadArgument("robot", evidence, "remove them from the model: links are rigid")


def _add_body(model: Any, number: int, bodies: _MujocoParts) -> None:
    """Add a body with its joints; the links between two joints of one body are without mass."""
    name, carrier = bodies.names[number], int(model.body_parentid[number])
    rotation = _rotation(model.body_quat[number])
    translation = bodies.origins[carrier] + model.body_pos[number]
    own = _rotation(model.body_iquat[number])
    tensor = own @ np.diag(model.body_inertia[number]) @ own.T
    inertia = Inertia.from_centre_of_mass(model.body_mass[number], model.body_ipos[number], tensor)
    parent, at = bodies.names[carrier], np.zeros(3)
    first, count = int(model.body_jntadr[number]), int(model.body_jntnum[number])
    if not count or (_floats(model, number) and np.any(model.jnt_type >= _SLIDE)):  # held where it is
        fixed = np.array([0.0, 0.0, 1.0])
        joint = Connection(f"{name} (fixed)", "fixed", parent, name, rotation, translation, fixed, JointLimits())
        bodies.joints[f"{name} (fixed body)"] = joint
        count = 0
    for moved in range(first, first + count):  # at: origin of the link so far in the frame of the body
        anchor = np.array(model.jnt_pos[moved])
        is_last = moved == first + count - 1
        child = name if is_last else f"{name} before {bodies.moving[moved + 1]}"
        place = rotation, translation + rotation @ (anchor - at)
        bodies.joints[bodies.moving[moved]] = _joint(model, moved, (bodies.moving[moved], parent, child), place)
        if not is_last:
            bodies.inertias[child] = between_joints(inertia)
        parent, rotation, translation, at = child, np.eye(3), np.zeros(3), anchor
    bodies.inertias[name] = inertia.moved(np.eye(3), -at)
    bodies.origins.append(-at)


def _floats(model: Any, number: int) -> bool:
    """Return whether a body floats freely."""
    return bool(model.body_jntnum[number]) and model.jnt_type[model.body_jntadr[number]] == _FREE


def _carries_joints(model: Any, number: int) -> bool:
    """Return whether what moves with a body at the top has joints below it."""
    return int(model.body_jntnum[model.body_rootid == number].sum()) > 1


def _joint(model: Any, number: int, names: tuple[str, str, str], place: tuple[Array, Array]) -> Connection:
    """Return a joint.

    Args:
        model: The model.
        number: The joint.
        names: Its name, and those of the bodies before and after it.
        place: Rotation and translation of the body after it, as the model is written.

    Raises:
        BadArgument: A free or ball joint.
    """
    if model.jnt_type[number] not in (_SLIDE, _HINGE):
        evidence = f"joint '{names[0]}' has more than one degree of freedom"
        raise BadArgument("robot", evidence, "give the model of an arm on a fixed base, with hinge and slide joints")
    rotation, translation = place
    dof, axis = int(model.jnt_dofadr[number]), np.array(model.jnt_axis[number])
    zero = float(model.qpos0[model.jnt_qposadr[number]])  # the position at which the bodies are placed as written
    is_hinge = model.jnt_type[number] == _HINGE
    if is_hinge:
        rotation = rotation @ rotation_about(axis, -zero)
    else:
        translation = translation - zero * rotation @ axis
    lower, upper = model.jnt_range[number] if model.jnt_limited[number] else (-np.inf, np.inf)
    rotor, damping, effort = _actuators(model, number)
    return Connection(
        names[0],
        "revolute" if is_hinge else "prismatic",
        names[1],
        names[2],
        rotation,
        translation,
        axis,
        JointLimits(lower=float(lower), upper=float(upper), effort=effort),
        damping=float(model.dof_damping[dof] + damping),
        friction=float(model.dof_frictionloss[dof]),
        drive=Drive(rotor_inertia=float(model.dof_armature[dof] + rotor)),
    )


def _actuators(model: Any, number: int) -> tuple[float, float, float]:
    """Return rotor inertia, damping and largest torque that the actuators of a joint give it."""
    motors = _motors(model, number)
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


def _motors(model: Any, number: int) -> list[int]:
    """Return the actuators of a joint, by number."""
    on_joint = (model.actuator_trntype <= _ON_JOINT) & (model.actuator_trnid[:, 0] == number)
    return [int(one) for one in np.flatnonzero(on_joint & (model.actuator_gear[:, 0] != 0.0))]


def _tie(model: Any, bodies: _MujocoParts) -> None:
    """Let joints follow others, or hold them still, as equality constraints of joints say.

    Raises:
        BadArgument: Another equality constraint, which closes a loop, or one that ties a joint again.
    """
    joints, tied, still = bodies.joints, set[str](), dict[str, float]()
    zeros = {name: float(model.qpos0[model.jnt_qposadr[number]]) for number, name in enumerate(bodies.moving)}
    for number in map(int, np.flatnonzero(model.eq_active0)):
        name = model.equality(number).name or f"number {number}"
        if _is_handle(model, number):
            continue
        tie = _tie_of(model, number, bodies.moving, tied)
        if tie is None:
            evidence = f"the equality constraint {name} is no linear one of joints"
            raise BadArgument("robot", evidence, "remove it from the model: loops of bodies are not read")
        one, leader, constant, slope = tie
        if one in tied:
            evidence = f"joint '{one}' is tied twice, by the equality constraint {name} too"
            raise BadArgument("robot", evidence, "keep one of the two")
        tied.add(one)
        if leader:
            follow = Mimic(leader, slope, zeros[one] + constant - slope * zeros[leader])
            joints[one] = replace(joints[one], mimic=follow)
        else:
            still[one] = zeros[one] + constant
    joints.update(with_held(joints, still))
    for words in filter(None, (ring(name, joints) for name in bodies.moving)):
        evidence = f"joints follow each other: {words}: redundant equality constraints"
        raise BadArgument("robot", evidence, "remove one of them from the model")


def _is_handle(model: Any, number: int) -> bool:
    """Return whether an equality ties a body to a mocap one, which moves as a simulation says."""
    ends = (int(model.eq_obj1id[number]), int(model.eq_obj2id[number]))
    of_bodies = model.eq_type[number] in _LOOPS and model.eq_objtype[number] == _BODY
    return of_bodies and any(model.body_mocapid[end] >= 0 for end in ends)


def _tie_of(model: Any, number: int, joints: Sequence[str], tied: Set[str]) -> tuple[str, str, float, float] | None:
    """Return joint, leader (empty: held still), constant and slope of an equality; None of one that is not linear."""
    ends = [int(end) for end in (model.eq_obj1id[number], model.eq_obj2id[number]) if end >= 0]
    constant, slope, *rest = polynomial = [float(value) for value in model.eq_data[number][:5]]
    if model.eq_type[number] == _EQUALITY_OF_JOINTS:
        one, *other = (joints[end] for end in ends)
        return None if other and (any(rest) or slope == 0.0) else (one, other[0] if other else "", constant, slope)
    if model.eq_type[number] != _EQUALITY_OF_TENDONS:
        return None
    return tied_by_lengths([_length(model, end, joints) for end in ends], polynomial, tied)


def _length(model: Any, tendon: int, joints: Sequence[str]) -> dict[str, float] | None:
    """Return the coefficient of each joint in the length of a tendon; None of one that is not ``<fixed>``."""
    part = slice(int(model.tendon_adr[tendon]), int(model.tendon_adr[tendon] + model.tendon_num[tendon]))
    if np.any(model.wrap_type[part] != _WRAP_JOINT):
        return None
    pairs = zip(model.wrap_objid[part], model.wrap_prm[part], strict=True)
    return {joints[int(joint)]: float(coefficient) for joint, coefficient in pairs}


def _note(model: Any, off: Set[str]) -> str:
    """Return where the robot is from, with what has a torque in MuJoCo and none here."""
    curved = (np.any(getattr(model, name, 0.0)) for name in ("dof_dampingpoly", "actuator_dampingpoly"))
    stiff = np.any(model.jnt_stiffness) or np.any(getattr(model, "jnt_stiffnesspoly", 0.0))
    is_passive = not {"spring", "damper"} <= off
    bases = [_carries_joints(model, number) for number in range(1, model.nbody) if _floats(model, number)]
    without = {
        "springs of joints": stiff and "spring" not in off,
        "damping of second and third order": any(curved) and "damper" not in off,
        "gravity compensation of bodies": np.any(model.body_gravcomp) and is_passive,
        "tendons": model.ntendon > 0,
        "bodies that float freely": not all(bases),
        FLOATING: any(bases),
        "what ties it to mocap bodies": any(_is_handle(model, int(one)) for one in np.flatnonzero(model.eq_active0)),
        "a fluid": (model.opt.density > 0 or model.opt.viscosity > 0) and is_passive,
    }
    left = [what for what, is_there in without.items() if is_there]
    return "read from a model of MuJoCo" + (f"; without {', '.join(left)}" if left else "")


def _rotation(quaternion: Array) -> Array:
    """Return the rotation of a quaternion (w, x, y, z) of any length, shape (3, 3)."""
    return rotation_from_quaternion(quaternion / np.linalg.norm(quaternion))
