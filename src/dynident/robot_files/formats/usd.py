"""USD -> Robot: stages with the schema UsdPhysics, read by OpenUSD without a simulator."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, ClassVar, Final, final

import numpy as np

from dynident.errors import DescriptionError
from dynident.model.robot import Frame, Robot
from dynident.robot_files.formats.base import Description
from dynident.robot_files.tree import assemble, with_unknown

if TYPE_CHECKING:
    from dynident.robot_files.usd_parts import StageParts

#: First bytes of its kinds of files: text, binary ("crate"), archive.
_HEADS: Final = {b"#usda": ".usda", b"PXR-USDC": ".usdc", b"PK\x03\x04": ".usdz"}


@final
@dataclass(frozen=True)
class UsdModel(Description):
    """USD with rigid bodies and joints of the schema UsdPhysics (extra ``usd``), as text, binary or archive.

    Read: rigid bodies with mass, centre of mass, diagonal inertia and principal axes; revolute, prismatic and fixed
    joints between two bodies or a body and the world, with limits; drives: largest force, and damping where there is
    no stiffness; ``armature`` and largest velocity of PhysX; gravity of the scene; units and up axis of the stage.

    Choices where the schema leaves room:

    * The base is the world. A body that a fixed joint ties to it is a frame of the base.
    * The frame of a link has the axes of its prim; its origin is where its joint turns, as a rule that of the prim.
    * A joint is at zero where its two frames coincide, wherever the bodies are drawn.
    * Where mass, centre or inertia are not stated, simulators compute them from shapes: the inertia is unknown here.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".usda", ".usd", ".usdc", ".usdz")
    opening: ClassVar[bytes] = b"#usda"

    def read(self, path: object, data: bytes) -> Robot:
        suffix = next((ending for head, ending in _HEADS.items() if data.startswith(head)), "")
        if not suffix:
            raise DescriptionError(path, "", "no USD by its first bytes", "export the stage again")
        from dynident.robot_files.usd_stage import read_stage  # few need it

        if os.path.isfile(str(path)):
            return robot_of_stage(path, read_stage(str(path)))
        with tempfile.TemporaryDirectory(prefix="dynident-") as folder:
            file = Path(folder) / f"{Path(str(path)).stem}{suffix}"
            file.write_bytes(data)
            return robot_of_stage(path, read_stage(file))

    def included(self, path: object, data: bytes) -> tuple[str, ...]:
        from dynident.robot_files.usd_parts import open_stage

        stage = open_stage(str(path))  # its layers live as long as it does
        files = {os.path.realpath(layer.realPath) for layer in stage.GetUsedLayers() if os.path.isfile(layer.realPath)}
        return tuple(sorted(files - {os.path.realpath(str(path))}))


def robot_of_stage(path: object, parts: StageParts) -> Robot:
    """Return the robot that the bodies and joints of a stage make.

    Raises:
        DescriptionError: No joint moves.
    """
    note = "; ".join([f"read from {PurePath(str(path)).name}", *parts.notes])
    shapes, visuals = ({name: getattr(one, key) for name, one in parts.bodies.items()} for key in ("shapes", "visuals"))
    robot = assemble(path, parts.name, parts.inertias, parts.connections, note, shapes, visuals)
    robot = with_unknown(robot, parts.unknown)
    frames = dict(robot.frames)
    for number, link in enumerate(robot.links):
        shift = parts.bodies[link.name].shift
        if np.any(shift):
            frames[f"{link.name}_prim"] = Frame(number, np.eye(3), -shift)
    robot = replace(robot, frames=frames).with_gravity(parts.gravity)
    return robot.with_drives(parts.drives) if parts.drives else robot
