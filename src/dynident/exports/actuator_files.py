"""Actuators as files: MuJoCo models, tables for Isaac and Genesis, joint dynamics of a URDF, C."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from defusedxml import ElementTree

from dynident.actuators.estimate import ActuatorEstimate, JointActuator
from dynident.actuators.parameters import PLACE
from dynident.errors import BadOption, MissingDependency, UnknownChoice
from dynident.exports.actuator_bodies import robot_of, set_bodies, urdf_of
from dynident.exports.names_in_files import shown_names

#: The friction that all targets have: Coulomb and viscous.
PLAIN: Final = "m1"

#: Step of an exported MuJoCo model in s.
TIMESTEP: Final = 5e-4


@dataclass(frozen=True)
class SimulatorJoint:
    """The actuator of a joint in the terms of simulators: friction is Coulomb and viscous, the parameters are SI.

    Attributes:
        name: The joint.
        stiffness: Torque per rad of error, in N m/rad.
        damping: Viscous friction and back-EMF together, in N m s/rad: that of the joint while the drive is on.
        viscous: Viscous friction alone, in N m s/rad.
        frictionloss: Coulomb friction, in N m.
        armature: Rotor inertia at the joint, in kg m^2.
        largest_torque: Torque at the duty limit, in N m; infinite where the law has none or the logs do not tell it.
        damping_gain: Torque per velocity error, in N m s/rad.
        delay_s: Time until a command acts.
        slew_limit: Fastest change of the goal inside the drive, in rad/s; infinite for none.
        angle_offset: True joint angle less the encoder's, in rad.
    """

    name: str
    stiffness: float
    damping: float
    viscous: float
    frictionloss: float
    armature: float
    largest_torque: float
    damping_gain: float
    delay_s: float
    slew_limit: float
    angle_offset: float


def simulator_joint(joint: JointActuator, kp: float) -> SimulatorJoint:
    """Return the actuator of a joint at a position gain, by its fit with Coulomb and viscous friction."""
    values = joint.simple

    def value(name: str) -> float:
        return float(values[PLACE[name]])

    return SimulatorJoint(
        name=joint.name,
        stiffness=value("full_torque") * value("gain_ratio") * joint.law.error_gain * kp,
        damping=value("viscous") + value("back_emf"),
        viscous=value("viscous"),
        frictionloss=value("coulomb"),
        armature=value("armature"),
        largest_torque=value("full_torque") * joint.law.limit if joint.has_limit else np.inf,
        damping_gain=value("full_torque") * value("damping_gain"),
        delay_s=value("delay"),
        slew_limit=value("slew_limit"),
        angle_offset=value("angle_offset"),
    )


def written_limit(joint: JointActuator, effort: float) -> float:
    """Return the force limit of a joint in a robot model that has an effort limit, in N m; infinite for none.

    That of the duty where it is known. Else that of the robot model, but no less than the drive gave in the logs.
    """
    known = simulator_joint(joint, 1.0).largest_torque
    return known if np.isfinite(known) else float(np.fmax(effort, joint.largest_torque))


def command_words(joint: JointActuator, kp: float) -> str:
    """Return how commanded velocity and torque enter the command of a position actuator; empty where it has neither.

    Its force is that of the drive then, its limit too: kp (q_ref - q) + kd (dq_ref - dq) + torque.
    """
    one, (angle, torque) = simulator_joint(joint, kp), ("m", "N") if joint.slides else ("rad", "(N m)")
    found = [f"{one.damping_gain / one.stiffness:.6g} s * velocity"] if one.damping_gain else []
    if joint.law.controls_torque:
        found.append(f"{joint.simple[PLACE['full_torque']] / one.stiffness:.6g} {angle}/{torque} * torque")
    return " + ".join(["ctrl = position", *found]) if found else ""


def gain_for(estimate: ActuatorEstimate, kp: float | None) -> float:
    """Return the position gain of an export: the given one, or that of the training logs where there is one.

    Raises:
        BadOption: The training logs have several, and none is given.
    """
    if kp is not None:
        if not 0 < kp < np.inf:
            raise BadOption("kp", kp, "give the position gain of the drive, above 0")
        return kp
    gains = sorted({value for joint in estimate.joints for value in joint.kp})
    if len(gains) > 1:
        those = ", ".join(f"{value:g}" for value in gains)
        raise BadOption("kp", None, f"the logs have kp {those}; say which with --option kp=...")
    return gains[0] if gains else 1.0


def _robot_path(estimate: ActuatorEstimate) -> str:
    path = str(dict(estimate.provenance.get("robot", {})).get("path", ""))
    if not Path(path).is_file():
        raise BadOption("robot", path or None, "the robot model of the identification is not there; put it back")
    return path


def mujoco_model(estimate: ActuatorEstimate, kp: float) -> str:
    """Return the robot model as MJCF with position actuators, armature, damping, frictionloss and delay.

    Raises:
        MissingDependency: MuJoCo is not installed.
        BadOption: The robot model is not where it was.
    """
    spec = mujoco_spec(estimate, kp)[1]
    spec.compile()
    return str(spec.to_xml())


def mujoco_spec(estimate: ActuatorEstimate, kp: float) -> tuple[Any, Any]:
    """Return the module of MuJoCo, and the robot model with the actuators as its MjSpec.

    They replace the actuators and the armature, damping, frictionloss and effort limits that the model has for these
    joints; an effort limit stays where the largest torque is not known and the logs do not contradict it.

    Raises:
        MissingDependency: MuJoCo is not installed.
        BadOption: The robot model is not where it was.
    """
    try:
        import mujoco
    except ImportError as error:
        raise MissingDependency("the MuJoCo model", "mujoco", "mujoco") from error
    engine: Any = mujoco  # without types of its own
    path = _robot_path(estimate)
    spec = engine.MjSpec.from_file(path)
    set_bodies(spec, estimate, path)
    spec.option.timestep = TIMESTEP
    spec.option.integrator = engine.mjtIntegrator.mjINT_IMPLICITFAST
    names = {joint.name for joint in estimate.joints}
    efforts = {joint.name: joint.limits.effort for joint in robot_of(estimate).active}  # also those of its actuators
    for old in list(spec.actuators):  # the model's own would act beside the identified ones
        if old.trntype == engine.mjtTrn.mjTRN_JOINT and old.target in names:
            spec.delete(old)
    for own in estimate.joints:
        one = simulator_joint(own, kp)
        joint = spec.joint(one.name)
        joint.armature, joint.damping, joint.frictionloss = one.armature, [one.damping, 0, 0], one.frictionloss
        joint.solref_friction = [2.0 * TIMESTEP, 1.0]
        actuator = spec.add_actuator(name=one.name, target=one.name, trntype=engine.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=one.stiffness, kv=one.damping_gain)
        if words := command_words(own, kp):
            spec.add_text(name=f"{one.name}_command", data=words)
        most = written_limit(own, efforts.get(own.name, np.inf))
        if np.isfinite(most):
            actuator.forcelimited, actuator.forcerange = True, [-most, most]
            joint.actfrclimited, joint.actfrcrange = True, [-most, most]
        if one.delay_s > 0:
            actuator.delay = one.delay_s
            actuator.nsample = int(np.ceil(one.delay_s / TIMESTEP)) + 1
    return engine, spec


def _rows(estimate: ActuatorEstimate, kp: float) -> dict[str, SimulatorJoint]:
    return {joint.name: simulator_joint(joint, kp) for joint in estimate.joints}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def isaac_table(estimate: ActuatorEstimate, kp: float) -> str:
    """Return JSON with the fields of an implicit actuator of Isaac Lab, by joint."""
    table = {
        name: {
            "stiffness": one.stiffness,
            "damping": one.damping_gain,
            "effort_limit_sim": _finite(one.largest_torque),
            "armature": one.armature,
            "friction": one.frictionloss,
            "viscous_friction": one.damping,
            "delay_s": one.delay_s,
            "goal_slew_limit": _finite(one.slew_limit),
            "angle_offset": one.angle_offset,
        }
        for name, one in _rows(estimate, kp).items()
    }
    return json.dumps(table, indent=1) + "\n"


def genesis_table(estimate: ActuatorEstimate, kp: float) -> str:
    """Return YAML with the values of the degree-of-freedom setters of Genesis, by joint."""
    table = {
        name: {
            "kp": one.stiffness,
            "kv": one.damping_gain,
            "force_range": [_finite(-one.largest_torque), _finite(one.largest_torque)],
            "armature": one.armature,
            "frictionloss": one.frictionloss,
            "damping": one.damping,
            "delay_s": one.delay_s,
            "goal_slew_limit": _finite(one.slew_limit),
            "angle_offset": one.angle_offset,
        }
        for name, one in _rows(estimate, kp).items()
    }
    return str(yaml.safe_dump(table, sort_keys=False))


def urdf_dynamics(estimate: ActuatorEstimate, kp: float) -> str:
    """Return the URDF of the identification with ``<dynamics damping friction>`` and effort limits of the joints.

    Raises:
        BadOption: The robot model is no URDF, or not where it was.
    """
    path = _robot_path(estimate)
    if not path.lower().endswith(".urdf"):
        raise BadOption("to", "urdf", f"the robot model of the identification is {path}, no URDF")
    root = ElementTree.fromstring(urdf_of(estimate, path))
    actuators = {joint.name: joint for joint in estimate.joints}
    for joint in root.iter("joint"):
        own = actuators.get(joint.get("name", ""))
        if own is None:
            continue
        one = simulator_joint(own, kp)
        for old in joint.findall("dynamics"):
            joint.remove(old)
        dynamics = {"damping": f"{one.damping:.9g}", "friction": f"{one.frictionloss:.9g}"}
        joint.append(joint.makeelement("dynamics", dynamics))
        limit = joint.find("limit")
        if limit is not None:
            most = written_limit(own, float(limit.get("effort", 0.0)) or np.inf)
            if np.isfinite(most):
                limit.set("effort", f"{most:.9g}")
    return str(ElementTree.tostring(root, encoding="unicode")) + "\n"


#: Before the numbers of a C header. Torques are those on the joint; positions those that the encoder reads.
_C_LAW: Final = """/* Actuators of position servos in SI units; friction is Coulomb and viscous.
   A command acts delay_s after it is given. A position is what the encoder reads: the joint's angle less angle_offset.
   Inertia of the joint: that of the bodies and armature. MIT mode: a feed-forward torque adds torque / kp to the goal,
   kp that of the export. */
#pragma once
#include <math.h>

typedef struct {
    const char *joint;
    double %s;
} ServoActuator;

/* Goal inside the drive, rad: it follows the command at the slew limit, from its last value over a step in s. */
static inline double servo_goal(const ServoActuator *a, double last, double command, double step)
{
    double most = a->slew_limit * step;
    return last + fmin(fmax(command - last, -most), most);
}

/* Torque of a drive that is on, N m: gains, force limit and back-EMF. */
static inline double servo_torque(const ServoActuator *a, double goal, double goal_rate, double position, double rate)
{
    double asked = a->stiffness * (goal - position) + a->damping_gain * (goal_rate - rate);
    double most = a->largest_torque;
    return fmin(fmax(asked, -most), most) - (a->damping - a->viscous) * rate;
}

/* Torque of friction that opposes the motion, N m; at rest it has any value within frictionloss. */
static inline double servo_friction(const ServoActuator *a, double rate)
{
    return a->viscous * rate + a->frictionloss * ((rate > 0) - (rate < 0));
}

"""


def c_header(estimate: ActuatorEstimate, kp: float) -> str:
    """Return a C header (C99) with the actuator of each joint and the drive law and friction as functions."""
    rows = _rows(estimate, kp)
    keys = [one.name for one in fields(SimulatorJoint) if one.name != "name"]
    names, _ = shown_names(tuple(rows))
    lines = [f"enum {{ SERVO_COUNT = {len(rows)} }};", "static const ServoActuator servo_actuators[SERVO_COUNT] = {"]
    for name, one in zip(names, rows.values(), strict=True):
        values = [float(getattr(one, key)) for key in keys]
        written = [f"{value:.17g}" if np.isfinite(value) else "INFINITY" for value in values]
        lines.append(f'    {{"{name}", {", ".join(written)}}},')
    return _C_LAW % ", ".join(keys) + "\n".join([*lines, "};", ""])


#: What writes the text of each target.
TARGETS: Final[Mapping[str, Callable[[ActuatorEstimate, float], str]]] = {
    "mjcf": mujoco_model,
    "isaac": isaac_table,
    "genesis": genesis_table,
    "urdf": urdf_dynamics,
    "c_header": c_header,
}


def actuator_file(estimate: ActuatorEstimate, target: str, options: Mapping[str, Any]) -> str:
    """Return the text of a target.

    Raises:
        UnknownChoice: No such target.
        BadOption: Another option than kp, or one that is no number; several gains and none is given.
        MissingDependency: MuJoCo is not installed.
    """
    if target not in TARGETS:
        raise UnknownChoice("target for actuators", target, tuple(TARGETS))
    for key, value in options.items():
        if key != "kp":
            raise BadOption(key, value, "actuators take the option kp")
    return TARGETS[target](estimate, stated_gain(estimate, options))


def stated_gain(estimate: ActuatorEstimate, options: Mapping[str, Any]) -> float:
    """Return the position gain of an export by its options.

    Raises:
        BadOption: It is no number, or the training logs have several, and none is given.
    """
    stated = options.get("kp")
    try:
        return gain_for(estimate, None if stated is None else float(stated))
    except ValueError as error:
        raise BadOption("kp", stated, "give a number") from error
