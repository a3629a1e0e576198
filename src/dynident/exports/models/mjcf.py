"""MJCF: the model of MuJoCo, with armature, damping, Coulomb friction and the drives that turn several joints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar
from xml.sax.saxutils import quoteattr

import numpy as np

from dynident.arrays import Array
from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.proving.engines import mujoco_torque, mujoco_version, pinocchio_torque, pinocchio_version
from dynident.exports.models.proving.robot_model_proof import reload_mjcf
from dynident.exports.models.subject.drives import Drives, Term, drives_of, rigid_torque
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.source import OwnDescription, anew_note
from dynident.exports.models.subject.states import StateSet
from dynident.exports.models.writing.document import document_bytes, friction_notes, left_out, place_beside
from dynident.exports.models.writing.mjcf_own import beside, patched_mjcf
from dynident.exports.models.writing.xml_edit import checked_names, number, numbers, quaternion, unused_name
from dynident.model.joint import Joint, rotation_about
from dynident.model.parameters import to_mujoco_fullinertia
from dynident.model.robot import Robot
from dynident.model.shapes import Box, Capsule, Cylinder, Shape, Sphere
from dynident.robot_files.mjcf.poses import IDENTITY, Pose, placed
from dynident.robot_files.tree import some

#: Distance in m of the nearer end of a balancer from the axis of its joint.
NEAR_END = 0.1


@dataclass(frozen=True)
class Mjcf(ModelExporter):
    """MJCF for MuJoCo: the robot model's own file, every other byte as it was, or a new one.

    Bodies, armature, damping, frictionloss. A new file has a motor a joint, coupled drives as fixed tendons, springs as
    stiffness of joints and balancers as spatial tendons.

    Attributes:
        motors: Whether each joint that moves on its own gets a motor, with its effort limit where that is known.
        lump: Whether bodies fixed to a moving one lose their inertia to it, in place of keeping what the file states.
    """

    motors: bool = True
    lump: bool = False

    suffix: ClassVar[str] = ".xml"
    proof: ClassVar[str] = "bodies, armature, damping and Coulomb friction by MuJoCo and Pinocchio"
    edits_description: ClassVar[bool] = True

    def content(self, subject: Identified, path: Path) -> ModelContent:
        drives = drives_of(subject)
        if subject.source is not None and subject.source.kind == "mjcf":
            return self._own(subject, subject.source, path)
        files = {path: self._text(subject, drives), place_beside(path): document_bytes(subject, drives)}
        left = left_out(drives, armature=True, coupled=True, springs=_springs(subject, drives))
        notes = [
            *anew_note(subject.source, subject.estimate, "MJCF"),
            "shapes are drawn and do not touch; meshes are left out",
        ]
        if links := [subject.model.robot.links[i].name for i in sorted(subject.between)]:
            notes.append(f"no body is written for {some(links)}, of next to no mass: the joints are of one body")
        if any(joint.mimic is not None for joint in subject.model.robot.joints):
            notes.append("joints that follow another are held to it by a soft equality constraint of MuJoCo")
        if drives.dry.any():
            notes.append("frictionloss is regularised by MuJoCo's solver: solreffriction and solimpfriction set how")
        return ModelContent(files, left, (*notes, *friction_notes(drives, "MJCF")))

    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: StateSet) -> Iterator[Reloaded]:
        path = folder / next(iter(content.files)).name
        drives = drives_of(subject)
        if subject.source is not None and subject.source.kind == "mjcf":
            patched = patched_mjcf(subject, drives, subject.source, self.lump, next(iter(content.files)))
            files = dict(list(content.files.items())[:-1])
            yield from reload_mjcf(subject, subject.source, patched, files, folder)
            return
        rigid = rigid_torque(subject, states.motion)
        what = "bodies, armature, damping, Coulomb friction"
        if name := mujoco_version():
            expected, more = rigid + drives.torque(states.motion, armature=True, coupled=True), ""
            if _springs(subject, drives):
                expected, more = expected + drives.spring_torque(states.motion), ", springs"
            yield Reloaded(name, what + more, mujoco_torque(path, "mjcf", states), expected)
        else:
            yield Reloaded("MuJoCo", why_not="not installed")
        if not (name := pinocchio_version()):
            yield Reloaded("Pinocchio", why_not="not installed")
        elif not drives.alone.all():
            yield Reloaded(name, why_not="it does not read the tendons of drives that turn several joints")
        elif subject.between:
            yield Reloaded(name, why_not="it makes one joint of those of one body")
        elif sum(joint.parent < 0 for joint in subject.model.robot.joints) > 1:
            yield Reloaded(name, why_not="it reads only the first of several bodies on the base")
        else:
            expected = rigid + drives.torque(states.motion, armature=True, coupled=False)
            yield Reloaded(name, what, pinocchio_torque(path, "mjcf", states), expected)

    def _own(self, subject: Identified, source: OwnDescription, path: Path) -> ModelContent:
        """Return the files of the user's MJCF with the model in them."""
        drives = drives_of(subject)
        patched = patched_mjcf(subject, drives, source, self.lump, path)
        files = {**beside(path, source, patched), place_beside(path): document_bytes(subject, drives)}
        notes = ((source.note,) if source.note else ()) + patched.notes
        return ModelContent(
            files, left_out(drives, armature=True, coupled=False), (*notes, *friction_notes(drives, "MJCF"))
        )

    def _text(self, subject: Identified, drives: Drives) -> bytes:
        robot = subject.model.robot
        checked_names("link", [link.name for link in robot.links])
        checked_names("joint", [joint.name for joint in robot.joints])
        checked_names("robot", [robot.name])
        lines = [
            f"<mujoco model={quoteattr(robot.name)}>",
            '  <compiler angle="radian" autolimits="true" inertiafromgeom="false" boundmass="0" boundinertia="0"/>',
            f'  <option gravity="{numbers(robot.gravity)}"/>',
            "  <worldbody>",
            *geoms(robot.base_shapes, "    "),
            *sites(robot, -1, "    "),
        ]
        balancers = tuple(_Balancer(term, drives) for term in _springs(subject, drives) if term.symbol == "Kb")
        lines += [line for one in balancers for line in one.sites(robot, -1, "    ")]
        lines += _bodies(subject, _Given(drives, _springs(subject, drives), balancers), -1, "    ")
        lines += ["  </worldbody>", *_tendons(drives, balancers), *_followers(robot)]
        if self.motors:
            lines += _motors(robot)
        return ("\n".join([*lines, "</mujoco>"]) + "\n").encode("utf-8")


def _springs(subject: Identified, drives: Drives) -> tuple[Term, ...]:
    """Return the springs that a new file holds: none where one body has several joints."""
    return () if subject.between else drives.springs


@dataclass(frozen=True)
class _Balancer:
    """A balancer as a spatial tendon between two sites; the torque is the same at any ``NEAR_END``."""

    term: Term
    drives: Drives

    def sites(self, robot: Robot, link: int, indent: str) -> Iterator[str]:
        """Yield its ends that are on a link, -1 for the base."""
        j = next(i for i, joint in enumerate(robot.joints) if joint.name == self.term.joint)
        joint, options = robot.joints[j], self.term.options
        across = np.cross(joint.axis, np.eye(3)[np.argmin(np.abs(joint.axis))])
        across *= NEAR_END / np.linalg.norm(across)
        if link == j:
            yield f'{indent}<site name={quoteattr(self._end(1))} pos="{numbers(options["ratio"] * across)}"/>'
        if link == joint.parent:
            place = joint.translation + joint.rotation @ rotation_about(joint.axis, options["dead_center"]) @ across
            yield f'{indent}<site name={quoteattr(self._end(0))} pos="{numbers(place)}"/>'

    def tendon(self, name: str) -> Iterator[str]:
        """Yield its tendon."""
        stiffness = self.term.value / (NEAR_END**2 * self.term.options["ratio"])
        force = sum(t.value for t in self.drives.springs if (t.joint, t.symbol) == (self.term.joint, "Fb"))
        slack = number(-NEAR_END * force / self.term.value)
        yield f'    <spatial name={quoteattr(name)} stiffness="{number(stiffness)}" springlength="{slack}">'
        yield from (f"      <site site={quoteattr(self._end(end))}/>" for end in (0, 1))
        yield "    </spatial>"

    def _end(self, end: int) -> str:
        return f"balancer of {self.term.joint}, {('base', 'link')[end]}"


@dataclass(frozen=True)
class _Given:
    """What joints and bodies of a new file are given of the drives."""

    drives: Drives
    springs: tuple[Term, ...]
    balancers: tuple[_Balancer, ...]

    def of_joint(self, name: str) -> list[float]:
        """Return armature, damping, friction loss, stiffness and the position without torque of a joint."""
        drives, j = self.drives, self.drives.joints.index(name)
        springs = [t for t in self.springs if t.part == "spring" and t.joint == name]
        stiffness = sum(t.value for t in springs)
        rest = sum(t.value * t.options["rest"] for t in springs) / stiffness if stiffness else 0.0
        return [*(float(value[j]) for value in drives.at_joints()), stiffness, rest]


def _bodies(subject: Identified, given: _Given, parent: int, indent: str) -> Iterator[str]:
    """Yield the bodies on a link, and all on them; joints with next to no mass between them are of one body."""
    robot = subject.model.robot
    for first, carried in enumerate(robot.joints):
        if carried.parent != parent:
            continue
        joints = [first]
        while joints[-1] in subject.between:
            joints.append(next(k for k, joint in enumerate(robot.joints) if joint.parent == joints[-1]))
        i, placed_joints = joints[-1], list[tuple[Joint, Array]]()
        at: Pose = IDENTITY  # the body in the frame of a joint, from the last one up
        for joint in (robot.joints[k] for k in reversed(joints)):
            moved = joint if joint is robot.joints[i] else replace(joint, axis=at[0].T @ joint.axis)
            placed_joints.insert(0, (moved, -at[0].T @ at[1]))
            at = placed((joint.rotation, joint.translation), at)
        link, body, inner = robot.links[i], subject.bodies[i], indent + "  "
        yield f"{indent}<body name={quoteattr(link.name)} {pose(*at)}>"
        full = to_mujoco_fullinertia(np.array([body.about_centre[a] for a in _SIX]))
        yield (
            f'{inner}<inertial pos="{numbers(body.centre_of_mass)}" mass="{number(body.mass)}" '
            f'fullinertia="{numbers(full)}"/>'
        )
        for joint, anchor in placed_joints:
            own = given.of_joint(joint.name) if joint.mimic is None else []
            yield inner + joint_line(joint, anchor, own)
        yield from geoms(link.shapes, inner)
        yield from sites(robot, i, inner)
        yield from (line for one in given.balancers for line in one.sites(robot, i, inner))
        yield from _bodies(subject, given, i, inner)
        yield f"{indent}</body>"


#: Entries of a tensor in the order of the first six of TEN.
_SIX = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def _tendons(drives: Drives, balancers: Sequence[_Balancer]) -> Iterator[str]:
    """Yield a fixed tendon, whose length is the motor's position, for each drive of several joints; and balancers."""
    coupled = np.flatnonzero(~drives.alone)
    if not len(coupled) and not balancers:
        return
    yield "  <tendon>"
    taken: set[str] = set()
    for j in coupled:
        name = unused_name(f"drive of {drives.joints[j]}", taken)
        taken.add(name)
        yield (
            f'    <fixed name={quoteattr(name)} armature="{number(drives.armature[j])}" '
            f'damping="{number(drives.damping[j])}" frictionloss="{number(drives.dry[j])}">'
        )
        for k in np.flatnonzero(drives.coupling[j]):
            yield f'      <joint joint={quoteattr(drives.joints[k])} coef="{number(drives.coupling[j, k])}"/>'
        yield "    </fixed>"
    for one in balancers:
        yield from one.tendon(unused_name(f"balancer of {one.term.joint}", taken))
    yield "  </tendon>"


def _followers(robot: Robot) -> Iterator[str]:
    lines = [
        f"    <joint joint1={quoteattr(joint.name)} joint2={quoteattr(joint.mimic.joint)} "
        f'polycoef="{number(joint.mimic.offset)} {number(joint.mimic.multiplier)} 0 0 0"/>'
        for joint in robot.joints
        if joint.mimic is not None
    ]
    if lines:
        yield from ("  <equality>", *lines, "  </equality>")


def _motors(robot: Robot) -> Iterator[str]:
    yield "  <actuator>"
    for joint in robot.active:
        effort = joint.limits.effort
        bound = f' ctrlrange="{number(-effort)} {number(effort)}"' if np.isfinite(effort) and effort > 0 else ""
        yield f"    <motor name={quoteattr(joint.name)} joint={quoteattr(joint.name)}{bound}/>"
    yield "  </actuator>"


_UNTOUCHED = 'contype="0" conaffinity="0"'


def pose(rotation: Array, translation: Array) -> str:
    """Return the attributes pos and quat of a pose."""
    return f'pos="{numbers(translation)}" quat="{numbers(quaternion(rotation))}"'


def joint_line(joint: Joint, anchor: Array, values: Sequence[float]) -> str:
    """Return the element of a joint with what ``_Given.of_joint`` says of it; a range where both ends are known."""
    kind = "hinge" if joint.kind == "revolute" else "slide"
    lower, upper = joint.limits.lower, joint.limits.upper
    bound = f' range="{number(lower)} {number(upper)}"' if np.isfinite([lower, upper]).all() and lower < upper else ""
    named = zip(("armature", "damping", "frictionloss", "stiffness", "springref"), values, strict=False)
    text = "".join(f' {name}="{number(value)}"' for name, value in named if value)
    place = f' pos="{numbers(anchor)}"' if anchor.any() else ""
    return f'<joint name={quoteattr(joint.name)} type="{kind}"{place} axis="{numbers(joint.axis)}"{bound}{text}/>'


def geoms(shapes: Sequence[Shape], indent: str) -> Iterator[str]:
    """Yield the shapes that MJCF has without a file."""
    for shape in shapes:
        if isinstance(shape, Sphere):
            text = f'type="sphere" pos="{numbers(shape.centre)}" size="{number(shape.radius)}"'
        elif isinstance(shape, Box):
            text = f'type="box" {pose(shape.rotation, shape.translation)} size="{numbers(0.5 * shape.size)}"'
        elif isinstance(shape, Cylinder):
            size = f"{number(shape.radius)} {number(0.5 * shape.length)}"
            text = f'type="cylinder" {pose(shape.rotation, shape.translation)} size="{size}"'
        elif isinstance(shape, Capsule) and shape.length > 0 and shape.radius > 0:
            ends = f"{numbers(shape.start)} {numbers(shape.end)}"
            text = f'type="capsule" fromto="{ends}" size="{number(shape.radius)}"'
        else:
            continue
        yield f"{indent}<geom {text} {_UNTOUCHED}/>"


def sites(robot: Robot, link: int, indent: str) -> Iterator[str]:
    """Yield a site for each named frame on a link."""
    for name, frame in robot.frames.items():
        if frame.link == link and name.isprintable() and name.strip():
            yield f"{indent}<site name={quoteattr(name)} {pose(frame.rotation, frame.translation)}/>"
