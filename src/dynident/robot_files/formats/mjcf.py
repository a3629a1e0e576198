"""MJCF, the model of MuJoCo: strict, with its includes, defaults, frames and geoms as inertia."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, final

from dynident.model.robot import Robot
from dynident.robot_files.formats.base import Description


@final
@dataclass(frozen=True)
class MjcfFile(Description):
    """MJCF of MuJoCo (documentation of version 4.0): the bodies and joints of an arm; a base that floats is held.

    Read are compiler settings, defaults classes, includes, frames, replicas, attached models, hinges and slides with
    armature, damping, frictionloss, ref and ranges, inertials, geoms as inertia (meshes too), sites as frames, linear
    equality constraints of joints, gears and force limits of actuators.

    * A body with several joints is one link a joint; the links before the last are without mass. Link frames stand at
      the anchor of the joint, with the axes of the body.
    * ``Robot.note`` names what has a torque in MuJoCo and none here: springs, tendons, gravity compensation, a fluid,
      damping of higher order.
    * Refused with the remedy: ball joints, a model in which nothing but free bodies moves, loops of bodies, muscles,
      flexible bodies, redundant equalities, a missing include or mesh that is needed, unknown attributes.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".mjcf", ".xml")
    opening: ClassVar[bytes] = b"<"
    roots: ClassVar[tuple[str, ...]] = ("mujoco", "mujocoinclude")

    def read(self, path: object, data: bytes) -> Robot:
        from dynident.robot_files.mjcf.model import read_mjcf_model  # few need it

        return read_mjcf_model(path, data).robot()

    def included(self, path: object, data: bytes) -> tuple[str, ...]:
        from dynident.robot_files.mjcf.document import included_files

        return included_files(path, data)
