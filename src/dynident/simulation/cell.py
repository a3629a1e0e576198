"""The virtual cell: a robot with its controller, its friction and all that a real cell does to a motion and its log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.errors import BadOption
from dynident.simulation.controllers import CONTROLLERS, Controller
from dynident.simulation.effects import Bristles, Effort, Elasticity, Encoder, Payload, Recorder, Ripple, Tilt, Warming


@dataclass(frozen=True)
class Cell:
    """A cell around a robot; the default one is a stiff robot with a ``pd`` controller and perfect sensors.

    Attributes:
        controller: Joint controller, a part of the family.
        encoder: What controller and log see of the motion.
        ripple: Torque ripple of the drives.
        bristles: Friction that sticks and slips.
        elasticity: Springs between motors and joints.
        warming: Temperature of the drives.
        payload: A body that nobody knows of.
        tilt: How the base really stands.
        effort: How torques or currents are measured.
        recorder: How rows are taken.
        saturation: Whether torques stop at the joints' effort limits.
        lead_in: Length in s of a run-in from rest that is simulated, not logged; 0 starts on the motion.
        integration_rate: Steps a second, a multiple of all rates; None chooses.
        plant: ``own`` for the compiled dynamics, ``mujoco`` for those of MuJoCo in the same steps (slower; an
            independent check; needs the extra ``mujoco``).
    """

    controller: Controller = field(default_factory=lambda: CONTROLLERS.make("pd"))
    encoder: Encoder = field(default_factory=Encoder)
    ripple: Ripple = field(default_factory=Ripple)
    bristles: Bristles = field(default_factory=Bristles)
    elasticity: Elasticity = field(default_factory=Elasticity)
    warming: Warming = field(default_factory=Warming)
    payload: Payload = field(default_factory=Payload)
    tilt: Tilt = field(default_factory=Tilt)
    effort: Effort = field(default_factory=Effort)
    recorder: Recorder = field(default_factory=Recorder)
    saturation: bool = True
    lead_in: float = 2.0
    integration_rate: float | None = None
    plant: Literal["own", "mujoco"] = "own"

    def __post_init__(self) -> None:
        if self.plant not in ("own", "mujoco"):
            raise BadOption("plant", self.plant, "choose one of: own, mujoco")

    def data(self) -> dict[str, Any]:
        """Return every setting as plain data, with the keys of the section ``cell`` of a case file."""
        values = asdict(self)
        values["controller"] = {CONTROLLERS.name_of(self.controller): values["controller"]}
        return values

    def changes(self) -> tuple[str, ...]:
        """Return the keys of the effects that are not those of the default cell, but for encoder, effort, recorder."""
        usual = Cell(self.controller)
        names = (one.name for one in fields(self) if one.name not in ("encoder", "effort", "recorder"))
        return tuple(name for name in names if getattr(self, name) != getattr(usual, name))


#: Share of a joint's motion that its position error exceeds where the joint does not follow.
FOLLOWS = 0.25


@dataclass(frozen=True)
class CellRun:
    """What a virtual cell recorded, and what was true at the same moments.

    Attributes:
        log: The measured signals: q, dq where asked for, torque or current, temperature where friction depends on it;
            the commanded q_ref and dq_ref.
        truth: q, dq, ddq of the joints, temperature of the drives, and the torque of the drives at the joints: friction
            and rotors included, known bias and ripple left aside. Its time is that at which rows were really taken.
        friction: Torque that is lost in the drives, at the joints, ripple included, shape (N, n), in N m or N.
        link_torque: Torque behind the gears, which moves the bodies, shape (N, n), in N m or N.
        theta: Parameters of the plant, shape (p,), payload included.
        gravity: In the base frame, shape (3,), tilt included, in m/s^2.
        saturated: How many torques of the logged part were cut at the effort limits.
        integration_rate: Steps a second that were made.
    """

    log: Log
    truth: Log
    friction: Array
    link_torque: Array
    theta: Array
    gravity: Array
    saturated: int
    integration_rate: float

    def tracking_error(self) -> Array:
        """Return the root mean square of the true position error of each joint, shape (n,), in rad or m."""
        return np.sqrt(np.mean((np.asarray(self.log.q_ref) - np.asarray(self.truth.q)) ** 2, axis=0))

    def left_behind(self) -> Mapping[str, float]:
        """Return the joints that do not follow the motion, with their position error as a share of it, both rms."""
        moved = np.std(np.asarray(self.log.q_ref), axis=0)
        pairs = zip(self.log.joints, self.tracking_error(), moved, strict=True)
        return {joint: float(error / size) for joint, error, size in pairs if size > 0 and error > FOLLOWS * size}
