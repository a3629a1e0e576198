"""The servo that is assumed before there is a log: from limits of the robot model, or of an earlier estimate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.estimate import JointActuator
from dynident.actuators.parameters import FRICTION_MODELS, PLACE, neutral
from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.model.joint import Joint

#: Share of the loss of torque over speed that is viscous friction; the rest is back-EMF.
VISCOUS_SHARE: Final = 0.2

#: Coulomb friction as a share of the torque at full duty.
COULOMB_SHARE: Final = 0.05

#: Time in s in which full torque takes the rotor to its no-load speed.
START_UP_S: Final = 0.05

#: Delay in s where none is stated.
DELAY_S: Final = 0.01

#: Angle offset in rad.
OFFSET: Final = 0.01

#: Error in rad at which the torque saturates, where nobody knows the gain.
FULL_ERROR: Final = 0.2

#: Resolution in rad where the law states none: 4096 counts a turn.
RESOLUTION: Final = 2.0 * np.pi / 4096

#: That of a joint that slides, as a share of its range.
STEP_OF_SLIDES: Final = 1.0 / 4096

#: Other parameters of a friction model, where it has them: numbers, or shares of Coulomb friction.
_FRICTION: Final = {
    "load_motor": 0.1,
    "load_external": 0.1,
    "load_motor_stribeck": 0.05,
    "load_external_stribeck": 0.05,
    "load_motor_quadratic": 0.02,
    "load_external_quadratic": 0.02,
    "stribeck_velocity": 0.3,
    "stribeck_exponent": 1.3,
}


@dataclass(frozen=True)
class NominalServo:
    """The servo of a joint that motions are judged with.

    Attributes:
        law: Its drive law.
        friction: Name of its friction model.
        parameters: Shape (COUNT,).
        words: Where they come from, in words.
    """

    law: DriveLaw
    friction: str
    parameters: Array
    words: tuple[str, ...]

    def value(self, name: str) -> float:
        """Return a parameter by its name."""
        return float(self.parameters[PLACE[name]])

    def largest_torque(self) -> float:
        """Return the torque at the limit of the duty, in N m or N; infinite for none."""
        return self.value("full_torque") * self.law.limit


def of_estimate(actuator: JointActuator, law: DriveLaw, path: str) -> NominalServo:
    """Return the servo of an earlier estimate.

    Raises:
        BadOption: It was identified with another drive law.
    """
    own = (actuator.law.error_gain, actuator.law.limit, actuator.law.controls_torque)
    if own != (law.error_gain, law.limit, law.controls_torque):
        step = f"{actuator.name} has another drive law there ({actuator.law.name or 'stated'}); identify again"
        raise BadOption("--model", path, step)
    return NominalServo(law, actuator.friction, actuator.parameters.copy(), (f"parameters of {path}",))


def of_limits(joint: Joint, law: DriveLaw, friction: str, kp: float, carries_weight: bool) -> NominalServo:
    """Return a servo that reaches the effort and velocity limits of a joint; the rest is assumed, and said.

    Args:
        joint: With its limits, friction and armature as the robot model states them.
        law: Drive law.
        friction: Name of the friction model.
        kp: Position gain of the motions, for the stiffness of a drive whose gain nobody knows.
        carries_weight: Whether an angle offset has an effect.

    Raises:
        BadOption: The joint has no effort limit, or one of 0.
    """
    effort, speed = joint.limits.effort, joint.limits.velocity
    if not (np.isfinite(effort) and effort > 0):
        step = (
            "state the torque at full duty (limits: {effort: ...} in the case file), or an earlier estimate (--model)"
        )
        raise BadOption(f"effort limit of {joint.name}", effort, step)
    loss = effort / speed
    assumed, stated = [f"full torque takes the rotor to full speed in {1e3 * START_UP_S:g} ms"], []
    values = neutral()

    def put(name: str, value: float) -> None:
        values[PLACE[name]] = value

    put("full_torque", 1.0 if law.controls_torque else effort / min(law.limit, 1.0))
    put("back_emf", 0.0 if law.controls_torque else (1.0 - VISCOUS_SHARE) * loss)
    put("viscous", VISCOUS_SHARE * loss)
    put("coulomb", COULOMB_SHARE * effort)
    put("armature", START_UP_S * loss)
    for name, value in (("coulomb", joint.friction), ("armature", joint.drive.reflected_inertia)):
        if value:
            put(name, value)
            stated.append(name)
    if "coulomb" not in stated:
        assumed.append(f"Coulomb friction {100 * COULOMB_SHARE:g} % of full torque")
    if "armature" in stated:
        assumed.pop(0)
    model = FRICTION_MODELS[friction]
    for name in (*model.free, *(tied for tied, _ in model.tied)):
        if name in _FRICTION:
            put(name, _FRICTION[name])
    if "coulomb_stribeck" in model.free:
        put("coulomb_stribeck", 0.5 * values[PLACE["coulomb"]])
    put("delay", DELAY_S if law.delay_s is None else law.delay_s)
    put("slew_limit", np.inf if law.slew_limit is None else law.slew_limit)
    put("angle_offset", OFFSET if carries_weight else 0.0)
    put("damping_gain", law.damping_gain)
    if law.has_damping_gain:
        put("damping_gain", 1.0 if law.controls_torque else 0.02 * kp * law.error_gain)
    if law.gain_is_free:
        put("gain_ratio", law.limit / (FULL_ERROR * law.error_gain * kp))
        assumed.append(f"an error of {FULL_ERROR:g} rad saturates it")
    if law.delay_s is None:
        assumed.append(f"delay {1e3 * DELAY_S:g} ms")
    words = [f"torque {effort:.3g} and speed {speed:.3g} at full duty by the limits of effort and velocity"]
    words += [f"{' and '.join(stated)} by the robot model"] * bool(stated)
    words += [f"assumed: {', '.join(assumed)}"] * bool(assumed)
    return NominalServo(law, friction, values, tuple(words))
