"""What a real cell does to a motion and to its log, each effect a frozen value; a list of one number is for all joints.

Effects up to :class:`Payload` act inside the closed loop; :class:`Effort` and :class:`Recorder` only on what is logged.
Their fields are the keys of the section ``cell`` of a case file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption

Numbers = tuple[float, ...]


def each(name: str, values: Sequence[float], joints: int) -> Array:
    """Return one number per joint, shape (n,), from one for all or one each.

    Raises:
        BadOption: Another number of numbers.
    """
    if len(values) not in (1, joints):
        raise BadOption(name, list(values), f"give one number, or one for each of the {joints} joints")
    return np.ones(joints) * np.array(values, dtype=np.float64)


def check_numbers(effect: object, section: str, signed: Sequence[str] = (), positive: Sequence[str] = ()) -> None:
    """Refuse numbers of an effect that are not finite, or negative (at most 0 for ``positive``) but for ``signed``.

    Raises:
        BadOption: One is.
    """
    for field in fields(effect):  # type: ignore[arg-type]
        value = getattr(effect, field.name)
        if value is None or isinstance(value, str | bool):
            continue
        array = np.atleast_1d(np.array(value, dtype=np.float64))
        if not np.all(np.isfinite(array)) or (field.name not in signed and np.any(array < 0)):
            words = "finite numbers" if field.name in signed else "finite numbers, 0 or more"
            raise BadOption(f"{section}.{field.name}", value, f"give {words}")
        if field.name in positive and np.any(array == 0):
            raise BadOption(f"{section}.{field.name}", value, "give a number above 0")


def check_word(section: str, name: str, value: str, choices: Sequence[str]) -> None:
    """Refuse a word that is none of the choices.

    Raises:
        BadOption: It is not.
    """
    if value not in choices:
        raise BadOption(f"{section}.{name}", value, f"choose one of: {', '.join(choices)}")


@dataclass(frozen=True)
class Encoder:
    """What the controller and the log see of the motion. With elastic joints the encoders are at the motors.

    Attributes:
        resolution: Step of the measured positions, in rad or m at the joint; 0 for none.
        noise: Standard deviation of the measured positions before rounding, in rad or m.
        velocity: Where velocities come from: ``motor``, a sensor far finer than the logged positions (the true ones
            and ``velocity_noise``), or ``difference``, that of the measured positions between two ticks.
        velocity_noise: Standard deviation of the velocities, in rad/s or m/s; of the kind ``motor``.
        filter_hz: Corner frequency of a first-order filter of the velocities in the controller; 0 for none.
    """

    resolution: Numbers = (0.0,)
    noise: Numbers = (0.0,)
    velocity: Literal["motor", "difference"] = "motor"
    velocity_noise: Numbers = (0.0,)
    filter_hz: float = 0.0

    def __post_init__(self) -> None:
        check_numbers(self, "encoder")
        check_word("encoder", "velocity", self.velocity, ("motor", "difference"))


@dataclass(frozen=True)
class Ripple:
    """Torque of each drive that goes once round a shaft or more often: cogging, eccentric gears; no current shows it.

    Attributes:
        amplitude: In N m or N at the joint; 0 for none.
        cycles: Cycles per turn of the drive (of the joint, or of the motor where coupled); often the gear ratio.
        phase: Angle of the ripple at the position 0, in rad.
    """

    amplitude: Numbers = (0.0,)
    cycles: Numbers = (1.0,)
    phase: Numbers = (0.0,)

    def __post_init__(self) -> None:
        check_numbers(self, "ripple", signed=("phase",), positive=("cycles",))


@dataclass(frozen=True)
class Bristles:
    """Dry friction as bristles that bend, slip and stick (LuGre; Canudas de Wit, Olsson, Astrom and Lischinsky 1995).

    dz/dt = v - s0 |v| z / g, friction s0 z + s1 dz/dt, in the place of the smooth signs: g is the dry friction that
    coulomb, asymmetric, stribeck, load and temperature of the model state for a sharp sign, times the stiction here.

    Attributes:
        presliding: Deflection at which a joint breaks away, in rad or m at the drive; 0 for smooth signs.
        damping: Micro-damping s1 as a share of that which damps the bristles critically with the joint's inertia.
        stiction: By which share break-away friction exceeds dry friction; it fades as exp(-(v / velocity)^2).
        velocity: Speed of that fading, in rad/s or m/s.
    """

    presliding: float = 0.0
    damping: float = 0.3
    stiction: float = 0.0
    velocity: float = 0.05

    def __post_init__(self) -> None:
        check_numbers(self, "bristles", positive=("velocity",))


@dataclass(frozen=True)
class Elasticity:
    """Springs between motors and joints (Spong 1987): the motors have the rotor inertia, friction and the encoders.

    Every drive needs a rotor inertia then, known or identified.

    Attributes:
        stiffness: In N m/rad or N/m at the joint; 0 for stiff joints.
        damping: In N m s/rad or N s/m.
    """

    stiffness: Numbers = (0.0,)
    damping: Numbers = (0.0,)

    def __post_init__(self) -> None:
        check_numbers(self, "elasticity")


@dataclass(frozen=True)
class Warming:
    """Drives that warm up, T = end + (start - end) exp(-t / time_constant), and what that does to friction.

    A friction part ``temperature`` of the model sees T; the log then has it.

    Attributes:
        start: Temperature at the first sample of the log, in degrees Celsius.
        end: Temperature after a long time, in degrees Celsius.
        time_constant: In s.
        per_kelvin: Relative change of friction with speed (not with load) per degree above ``start``; -0.01 loses 1 %.
    """

    start: Numbers = (25.0,)
    end: Numbers = (25.0,)
    time_constant: float = 900.0
    per_kelvin: float = 0.0

    def __post_init__(self) -> None:
        check_numbers(self, "warming", signed=("start", "end", "per_kelvin"), positive=("time_constant",))


@dataclass(frozen=True)
class Payload:
    """A body fixed to a link that neither the robot model nor the controller knows.

    Attributes:
        mass: In kg.
        centre: Its centre of mass in the frame of the link, in m.
        inertia: Ixx, Iyy, Izz about its centre of mass along the axes of the link, in kg m^2.
        link: Name of the link; empty for the last one.
    """

    mass: float = 0.0
    centre: Numbers = (0.0, 0.0, 0.0)
    inertia: Numbers = (0.0, 0.0, 0.0)
    link: str = ""

    def __post_init__(self) -> None:
        check_numbers(self, "payload", signed=("centre",))
        for name in ("centre", "inertia"):
            if len(getattr(self, name)) != 3:
                raise BadOption(f"payload.{name}", list(getattr(self, name)), "give three numbers")


@dataclass(frozen=True)
class Tilt:
    """A base that does not stand as the robot model says: turned about its x axis, then its new y axis.

    Attributes:
        roll: About x, in rad.
        pitch: About y, in rad.
    """

    roll: float = 0.0
    pitch: float = 0.0

    def __post_init__(self) -> None:
        check_numbers(self, "tilt", signed=("roll", "pitch"))


@dataclass(frozen=True)
class Effort:
    """How torques or currents are measured.

    Attributes:
        noise: Standard deviation, in the unit of the logged signal: N m or N, A where it has currents.
        resolution: Step of the logged values, in that unit; 0 for none.
        delay_s: By how much they lag behind the positions of the same row, in s.
        side: ``motor`` for the torque of the drives, with what friction and rotors take of it; ``link`` for a sensor
            behind the gear.
        held: What a log says of a torque at the moment it jumps from one tick of the controller to the next: the
            ``mean`` of before and after, which stands beside the motion of its row, or ``after``, as a controller logs
            its commands, which stands half a tick early.
    """

    noise: Numbers = (0.0,)
    resolution: Numbers = (0.0,)
    delay_s: float = 0.0
    side: Literal["motor", "link"] = "motor"
    held: Literal["mean", "after"] = "mean"

    def __post_init__(self) -> None:
        check_numbers(self, "effort")
        check_word("effort", "side", self.side, ("motor", "link"))
        check_word("effort", "held", self.held, ("mean", "after"))


@dataclass(frozen=True)
class Recorder:
    """How rows are taken.

    Attributes:
        rate: Samples a second, in Hz.
        jitter_s: Standard deviation of the time of a row about its tick, in s; at most half a row's time is used.
        stamps: ``tick``, where the log says when a row should have been taken, or ``true``, when it was.
        dropped: Share of the rows that are missing, at random.
        velocities: Whether the log has velocities.
    """

    rate: float = 1000.0
    jitter_s: float = 0.0
    stamps: Literal["tick", "true"] = "tick"
    dropped: float = 0.0
    velocities: bool = False

    def __post_init__(self) -> None:
        check_numbers(self, "recorder", positive=("rate",))
        check_word("recorder", "stamps", self.stamps, ("tick", "true"))
        if not self.dropped <= 0.9:
            raise BadOption("recorder.dropped", self.dropped, "give a share of the rows, 0 to 0.9")
