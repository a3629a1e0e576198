"""SDF, the model of Gazebo and Drake: poses relative to named frames, nested models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, final

from dynident.model.robot import Robot
from dynident.robot_files.formats.base import Description


@final
@dataclass(frozen=True)
class SdfFile(Description):
    """SDF of versions 1.4 to 1.12: links and joints of one model, ``relative_to``, ``expressed_in``, nested models.

    * The link that no joint carries is the base, held still as that of a URDF; a joint with the parent ``world`` makes
      the world the base. Gravity is that of the world, seen from the base.
    * The frame of a link of the robot stands at its joint, with the axes of the link.
    * Rotor inertia and gear ratio are those of Drake's own elements.
    * Models that it includes are read with their pose and name there.
    * Refused with the remedy: joints with several degrees of freedom, ``<inertial auto="true">``, merged includes.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".sdf",)
    opening: ClassVar[bytes] = b"<"
    roots: ClassVar[tuple[str, ...]] = ("sdf",)

    def read(self, path: object, data: bytes) -> Robot:
        from dynident.robot_files.sdf_model import read_sdf_model  # few need it

        return read_sdf_model(path, data).robot()

    def included(self, path: object, data: bytes) -> tuple[str, ...]:
        from dynident.robot_files.sdf_includes import read_sdf_files

        return tuple(read_sdf_files(path, data)[1].texts)[1:]
