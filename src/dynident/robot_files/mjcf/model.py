"""An MJCF as a whole: its robot, and the bodies and joints of the file before they are merged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Final

from dynident.model.inertia import Inertia
from dynident.model.robot import Frame, Robot
from dynident.robot_files.leaders import carried_by_leaders, led_by_drives
from dynident.robot_files.mjcf.bodies import WORLD, MjcfTree, read_tree
from dynident.robot_files.mjcf.document import MjcfDocument, read_document
from dynident.robot_files.mjcf.poses import IDENTITY
from dynident.robot_files.mjcf.ties import tied
from dynident.robot_files.tree import Connection, assemble, some

#: The flags that, all switched off, end a torque which MuJoCo has and which is not read here.
_ENDED: Final[Mapping[str, set[str]]] = {
    "a fluid": {"spring", "damper"},
    "springs of joints": {"spring"},
    "springdamper of joints": {"spring", "damper"},
    "damping of second and third order": {"damper"},
    "gravity compensation of bodies": {"spring", "damper"},
}


@dataclass(frozen=True)
class MjcfModel:
    """What a file says.

    Attributes:
        document: Its elements.
        tree: Its bodies, with the elements that they come from.
        connections: Its joints, fixed ones included, in the order of the file.
    """

    document: MjcfDocument
    tree: MjcfTree
    connections: Sequence[Connection]

    def robot(self) -> Robot:
        """Return the robot, fixed bodies merged.

        Raises:
            DescriptionError: No joint moves.
        """
        document, tree = self.document, self.tree
        notes = {**({"a fluid": []} if document.has_fluid else {}), **tree.notes}
        left = [
            f"{what} ({some(names)})" if names else what
            for what, names in notes.items()
            if what not in _ENDED or not _ENDED[what] <= document.disabled.keys()
        ]
        note = f"read from {PurePath(str(document.path)).name}" + (f"; without {', '.join(left)}" if left else "")
        found = assemble(document.path, document.name, tree.bodies, self.connections, note, tree.shapes, tree.visuals)
        places = {WORLD: Frame(-1, *IDENTITY)}
        places |= {link.name: Frame(i, *IDENTITY) for i, link in enumerate(found.links)} | dict(found.frames)
        sites = {name: frame for name, frame in tree.frames(places).items() if name not in places}
        joints = carried_by_leaders(led_by_drives(found, tree.driven).joints)
        return replace(found, joints=joints, gravity=document.gravity, frames={**found.frames, **sites})


def read_mjcf_model(path: object, data: bytes, texts: Mapping[str, bytes] | None = None) -> MjcfModel:
    """Return what an MJCF says.

    Args:
        path: The file, beside which its includes and meshes are.
        data: Its bytes.
        texts: Bytes of includes by their path that count in place of what is in those files.

    Raises:
        DescriptionError: Any fault; the message names the file, the line and the element.
    """
    document = read_document(path, data, texts)
    tree = read_tree(document)
    total = sum(body.mass for body in tree.bodies.values() if body is not None)
    wanted = document.compiler.total_mass
    if wanted > 0.0 and total > 0.0:
        for name, body in tree.bodies.items():
            tree.bodies[name] = None if body is None else Inertia.from_vector(wanted / total * body.vector)
    return MjcfModel(document, tree, tied(document, tree))
