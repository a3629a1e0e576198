"""The rigid bodies and joints of a USD stage, by the schema UsdPhysics, without a simulator.

Source: OpenUSD, schema ``usdPhysics`` (rigid bodies, mass, joints, articulations, drives), and what Newton and PhysX
add to it (``newton:`` of newton-usd-schemas 0.6, ``physxJoint:``), read as plain attributes. Lengths are in units of
``metersPerUnit``, masses in units of ``kilogramsPerUnit``, angles of joints in degrees. A joint has a frame on each of
its two bodies (``localPos``, ``localRot``); it is at zero where the two coincide, wherever the bodies are drawn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from dynident.arrays import Array
from dynident.errors import DescriptionError
from dynident.model.documents.numbers import Place
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, JointLimits, Mimic
from dynident.model.shapes import Shape
from dynident.robot_files.rotations import rotation_from_quaternion
from dynident.robot_files.tree import Connection, some
from dynident.robot_files.usd_parts import (
    WORLD,
    StageBody,
    StageParts,
    StageUnits,
    check_values,
    numbers,
    open_stage,
    pxr_module,
    said,
    shape_of,
    whole_inertia,
)

#: Joints that are read, by the names of their prim types.
_KINDS: Final[Mapping[str, Literal["fixed", "revolute", "prismatic"]]] = {
    "PhysicsFixedJoint": "fixed",
    "PhysicsRevoluteJoint": "revolute",
    "PhysicsPrismaticJoint": "prismatic",
}

#: Largest deviation from 1 of the scale of a body.
_SCALE: Final = 1e-6

#: A unit in m or kg is above this, and below one over it.
_LEAST: Final = 1e-9

#: Gravity of a scene that states none, in m/s^2.
_GRAVITY: Final = 9.81


def read_stage(path: str | Path) -> StageParts:
    """Return bodies and joints of the stage in a file.

    Raises:
        MissingDependency: OpenUSD (usd-core) is not installed.
        DescriptionError: No stage, a missing layer, or something that is no arm on a fixed base.
    """
    try:
        return _StageReader(path, open_stage(path)).parts()
    except pxr_module("Tf").ErrorException as problem:
        raise DescriptionError(path, "", f"faulty USD ({said(problem)})", "export the stage again") from problem


@dataclass(frozen=True)
class _Side:
    """The frame of a joint on one of its bodies: name of the body, rotation, translation in m."""

    body: str
    rotation: Array
    translation: Array


@dataclass
class _StageReader:
    path: str | Path
    stage: Any
    notes: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        geometry, physics = pxr_module("UsdGeom"), pxr_module("UsdPhysics")
        self.physics, self.geometry = physics, geometry
        length = float(geometry.GetStageMetersPerUnit(self.stage))
        mass = float(physics.GetStageKilogramsPerUnit(self.stage))
        if not (_LEAST < length < 1.0 / _LEAST and _LEAST < mass < 1.0 / _LEAST):
            evidence = f"metersPerUnit is {length:g} and kilogramsPerUnit {mass:g}"
            raise DescriptionError(self.path, "", evidence, "write the units of the stage")
        self.units = StageUnits(length, mass)
        self.transforms = geometry.XformCache()
        prims = list(self.stage.Traverse(pxr_module("Usd").TraverseInstanceProxies()))
        self.rigid = {str(p.GetPath()): p for p in prims if p.HasAPI(physics.RigidBodyAPI)}
        self.joints = [p for p in prims if p.IsA(physics.Joint)]
        self.scenes = [p for p in prims if p.IsA(physics.Scene)]
        self.body_names = self._names(list(self.rigid.values()))
        self.joint_names = self._names(self.joints)

    @staticmethod
    def _names(prims: list[Any]) -> dict[str, str]:
        """Return names of prims by path: their own, or the path where two are called the same."""
        each = [prim.GetName() for prim in prims]
        return {
            str(prim.GetPath()): name if each.count(name) == 1 and name != WORLD else str(prim.GetPath())
            for prim, name in zip(prims, each, strict=True)
        }

    def parts(self) -> StageParts:
        if not self.rigid:
            step = "export it with physics: links need PhysicsRigidBodyAPI and joints"
            raise DescriptionError(self.path, "", "no prim has the schema PhysicsRigidBodyAPI", step)
        for prim in (*self.rigid.values(), *self.joints, *self.scenes):
            check_values(prim, self._place(prim))
        edges = list(self._edges())
        connections, drives, shifts = self._tree(edges)
        bodies = {}
        for key, prim in self.rigid.items():
            name = self.body_names[key]
            if name not in shifts:
                continue  # an object beside the robot
            inertia = self._inertia(prim)
            moved = None if inertia is None else inertia.moved(np.eye(3), -shifts[name])
            kinds = (tuple(one.moved(np.eye(3), -shifts[name]) for one in kind) for kind in self._shapes(prim))
            bodies[name] = StageBody(key, moved, shifts[name], *kinds)
        default = self.stage.GetDefaultPrim()
        name = default.GetName() if default else Path(str(self.path)).stem
        notes = tuple(dict.fromkeys(self.notes))
        gravity, unknown = self._gravity(), tuple(self.unknown)
        return StageParts(name, bodies, tuple(connections), drives, gravity, self.units, notes, unknown)

    def _place(self, prim: Any) -> Place:
        return Place(self.path, f"prim {prim.GetPath()}")

    def _transform(self, prim: Any) -> Array:
        """Return the transform of a prim to the world, shape (4, 4)."""
        matrix = np.array(self.transforms.GetLocalToWorldTransform(prim))
        if not np.all(np.isfinite(matrix)):
            raise self._place(prim).error("its transform holds a value that is no number", "export the stage again")
        return matrix

    def _check_body(self, prim: Any) -> None:
        matrix = self._transform(prim)
        scale = np.linalg.norm(matrix[:3, :3], axis=1)
        if np.abs(scale - 1.0).max() > _SCALE or np.linalg.det(matrix[:3, :3]) < 0:
            told = ", ".join(f"{value:.6g}" for value in scale)
            raise self._place(prim).error(f"the body is scaled by ({told})", "apply the scale to its geometry")
        body = self.physics.RigidBodyAPI(prim)
        if body.GetRigidBodyEnabledAttr().Get() is False or body.GetKinematicEnabledAttr().Get():
            raise self._place(prim).error("the body is kinematic, or not enabled", "make it a dynamic rigid body")

    def _edges(self) -> Iterator[tuple[Any, str, _Side, _Side]]:
        """Yield prim, kind and both sides of each joint."""
        for prim in self.joints:
            joint, place = self.physics.Joint(prim), self._place(prim)
            if joint.GetJointEnabledAttr().Get() is False:
                self.notes.append(f"the joint {self.joint_names[str(prim.GetPath())]} is not enabled and not read")
                continue
            kind = str(prim.GetTypeName())
            if kind not in _KINDS:
                step = "write it with PhysicsRevoluteJoint, PhysicsPrismaticJoint and PhysicsFixedJoint"
                raise place.error(f"a joint of the type {kind} is not read", step)
            if joint.GetExcludeFromArticulationAttr().Get():
                raise place.error(
                    "it closes a loop (excludeFromArticulation)", "remove it: loops of bodies are not read"
                )
            if any("MimicJoint" in str(schema) for schema in prim.GetPrimTypeInfo().GetAppliedAPISchemas()):
                raise place.error("it follows another joint (a mimic joint of PhysX)", "remove that, or lock the joint")
            sides = (self._side(prim, joint, 0), self._side(prim, joint, 1))
            if sides[0].body == sides[1].body:
                raise place.error(f"it joins {sides[0].body} with itself", "name two bodies in physics:body0 and body1")
            yield prim, kind, *sides

    def _side(self, prim: Any, joint: Any, number: int) -> _Side:
        """Return the frame of a joint on one of its bodies, or in the world."""
        targets = (joint.GetBody0Rel() if number == 0 else joint.GetBody1Rel()).GetTargets()
        place = self._place(prim)
        if len(targets) > 1:
            raise place.error(f"physics:body{number} has {len(targets)} targets", "name one body")
        position = (joint.GetLocalPos0Attr() if number == 0 else joint.GetLocalPos1Attr()).Get()
        turn = (joint.GetLocalRot0Attr() if number == 0 else joint.GetLocalRot1Attr()).Get()
        quaternion = numbers(turn)
        length = float(np.linalg.norm(quaternion))
        if not abs(length - 1.0) < 1e-3:
            raise place.error(f"physics:localRot{number} has length {length:.4g}, not 1", "write a unit quaternion")
        rotation, translation = rotation_from_quaternion(quaternion / length), np.array(position, dtype=float)
        if not targets:
            return _Side(WORLD, rotation, translation * self.units.length)
        target = self.stage.GetPrimAtPath(targets[0])
        if not target:
            raise place.error(f"physics:body{number} names {targets[0]}, which is not there", "name a body of it")
        owner = target
        while owner and str(owner.GetPath()) not in self.rigid and not owner.IsPseudoRoot():
            owner = owner.GetParent()
        matrix = self._transform(target)
        is_body = str(owner.GetPath()) in self.rigid
        if is_body:
            self._check_body(owner)
            matrix = matrix @ np.linalg.inv(self._transform(owner))
        translation = translation @ matrix[:3, :3] + matrix[3, :3]
        directions = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=1)[:, None]
        name = self.body_names[str(owner.GetPath())] if is_body else WORLD
        return _Side(name, directions.T @ rotation, translation * self.units.length)

    def _tree(
        self, edges: list[tuple[Any, str, _Side, _Side]]
    ) -> tuple[list[Connection], dict[str, Drive], dict[str, Array]]:
        """Return the joints from the world outwards, rotor inertias, and where the link frame of each body is."""
        shifts: dict[str, Array] = {WORLD: np.zeros(3)}
        connections: list[Connection] = []
        drives: dict[str, Drive] = {}
        waiting = list(edges)
        while ready := [edge for edge in waiting if edge[2].body in shifts or edge[3].body in shifts]:
            prim, kind, first, second = ready[0]
            waiting.remove(ready[0])
            if first.body in shifts and second.body in shifts:
                step = "remove one joint of the loop: loops of bodies are not read"
                raise self._place(prim).error(f"it closes a loop between {first.body} and {second.body}", step)
            is_forward = first.body in shifts
            near, far = (first, second) if is_forward else (second, first)
            shifts[far.body] = far.translation if kind != "PhysicsFixedJoint" else np.zeros(3)
            connection, drive = self._connection(prim, near, far, shifts, 1.0 if is_forward else -1.0)
            connections.append(connection)
            if drive is not None:
                drives[connection.name] = drive
        lost = sorted(set(self.body_names.values()) - set(shifts))
        is_arm = any(joint.kind != "fixed" for joint in connections)
        if lost and is_arm and all(_KINDS[kind] == "fixed" for _, kind, *_ in waiting):
            self.notes.append(f"bodies that float freely beside the robot are left out ({some(lost)})")
        elif lost:
            step = "fix the base to the world by a PhysicsFixedJoint without physics:body0; remove bodies of the scene"
            evidence = f"{lost[0]} and {len(lost) - 1} more bodies are" if len(lost) > 1 else f"{lost[0]} is"
            raise DescriptionError(self.path, "", f"{evidence} not joined to the world: the base floats", step)
        return connections, drives, shifts

    def _connection(
        self, prim: Any, near: _Side, far: _Side, shifts: Mapping[str, Array], sign: float
    ) -> tuple[Connection, Drive | None]:
        """Return a joint from the link frame of the near body to that of the far one, with a known rotor inertia."""
        kind, name = _KINDS[str(prim.GetTypeName())], self.joint_names[str(prim.GetPath())]
        rotation = near.rotation @ far.rotation.T
        at = near.translation - shifts[near.body]
        if kind == "fixed":
            at = at - rotation @ far.translation
            zero = np.array([0.0, 0.0, 1.0])
            return Connection(name, kind, near.body, far.body, rotation, at, zero, JointLimits()), None
        joint = (self.physics.RevoluteJoint if kind == "revolute" else self.physics.PrismaticJoint)(prim)
        letter = str(joint.GetAxisAttr().Get())
        if letter not in ("X", "Y", "Z"):
            raise self._place(prim).error(f"physics:axis is '{letter}'", "write X, Y or Z")
        axis = sign * far.rotation[:, "XYZ".index(letter)]
        unit = math.radians(1.0) if kind == "revolute" else self.units.length
        lower, upper = float(joint.GetLowerLimitAttr().Get()) * unit, float(joint.GetUpperLimitAttr().Get()) * unit
        if not lower < math.inf or not upper > -math.inf:
            raise self._place(prim).error(
                f"its limits are {lower:g} and {upper:g}", "write the lower and the upper one"
            )
        if lower > upper:
            step = "make it a PhysicsFixedJoint, or write the limits in order"
            raise self._place(prim).error("its lower limit is above the upper one: it is locked", step)
        force = self.units.inertia if kind == "revolute" else self.units.mass * self.units.length
        angular = kind == "revolute"
        damping, effort = self._drive(prim, name, "angular" if angular else "linear", force)
        passive = self._number(prim, "newton:damping")
        if passive is not None:
            damping = (damping or 0.0) + passive * force / unit
        dry = self._number(prim, "newton:friction")
        speed = self._number(prim, "newton:velocityLimit", "physxJoint:maxJointVelocity")
        limits = JointLimits(
            lower, upper, math.inf if speed is None or speed <= 0 else speed * unit, effort=effort
        )  # fmt: skip
        if self._number(prim, "physxJoint:jointFriction"):
            self.notes.append(f"the joint friction of PhysX of {name} is not read: it is a share of the load")
        armature = self._number(prim, "newton:armature", "physxJoint:armature")
        inertia = self.units.inertia if angular else self.units.mass
        drive = Drive(rotor_inertia=armature * inertia) if armature else None
        found = Connection(
            name, kind, near.body, far.body, rotation, at, axis, limits, self._mimic(prim, unit), damping,
            None if dry is None else dry * force,
        )  # fmt: skip
        return found, drive

    def _drive(self, prim: Any, name: str, axis: str, force: float) -> tuple[float | None, float]:
        """Return damping in SI units and the largest effort of the drive of a joint.

        A drive without stiffness and target velocity gives a torque against the velocity: viscous friction. The
        damping of a servo is a gain of its controller.
        """
        if not prim.HasAPI(self.physics.DriveAPI, axis):
            return None, math.inf
        drive = self.physics.DriveAPI(prim, axis)
        largest = float(drive.GetMaxForceAttr().Get())
        if not largest >= 0:
            raise self._place(prim).error(f"the largest force of its drive is {largest:g}", "write 0 or more")
        damping = float(drive.GetDampingAttr().Get()) * force
        damping = damping * math.degrees(1.0) if axis == "angular" else damping / self.units.length
        if damping and drive.GetTypeAttr().Get() == "acceleration":
            self.notes.append(f"damping of the drive of {name} is per inertia (type acceleration) and not read")
            return None, math.inf
        if drive.GetStiffnessAttr().Get() or drive.GetTargetVelocityAttr().Get():
            self.notes.append(f"stiffness and damping of the drive of {name} are gains of a controller and not read")
            return None, largest * force
        return damping, largest * force

    def _mimic(self, prim: Any, unit: float) -> Mimic | None:
        """Return what a joint follows by the schema NewtonMimicAPI: q = coef0 + coef1 q of the leader."""
        leader = prim.GetRelationship("newton:mimicJoint")
        targets = leader.GetTargets() if leader else []
        enabled = prim.GetAttribute("newton:mimicEnabled").Get() if prim.HasAttribute("newton:mimicEnabled") else True
        if not targets or not enabled:
            return None
        name = self.joint_names.get(str(targets[0]))
        if name is None:
            step = "name a joint of the stage"
            raise self._place(prim).error(f"newton:mimicJoint names {targets[0]}, which is no joint", step)
        ratio, offset = self._number(prim, "newton:mimicCoef1"), self._number(prim, "newton:mimicCoef0")
        if ratio == 0.0:
            raise self._place(prim).error("newton:mimicCoef1 0 holds it still", "make it a PhysicsFixedJoint")
        return Mimic(name, 1.0 if ratio is None else ratio, (offset or 0.0) * unit)

    @staticmethod
    def _number(prim: Any, *names: str) -> float | None:
        """Return the value of the first of some attributes that is there."""
        values = (prim.GetAttribute(name).Get() for name in names if prim.HasAttribute(name))
        return next((float(value) for value in values if value is not None), None)

    def _inertia(self, prim: Any) -> Inertia | None:
        """Return the inertia of a body about the origin of its prim; None where a part of it is not stated."""
        mass = self.physics.MassAPI(prim)
        value, centre = float(mass.GetMassAttr().Get() or 0.0), np.array(mass.GetCenterOfMassAttr().Get(), dtype=float)
        diagonal = np.array(mass.GetDiagonalInertiaAttr().Get(), dtype=float)
        whole = whole_inertia(prim)
        missing = [
            what
            for what, is_there in (
                ("mass", value != 0.0),
                ("centerOfMass", bool(np.all(np.isfinite(centre)))),
                ("diagonalInertia", whole is not None or bool(np.any(diagonal))),
            )
            if not is_there
        ]
        name = self.body_names[str(prim.GetPath())]
        if missing:
            if len(missing) < 3 or any(touches for _, touches in self._parts_of(prim)):
                self.unknown.append(name)
                self.notes.append(f"{name} states no {' and no '.join(missing)}: simulators compute it from shapes")
            return None
        if not 0.0 < value < math.inf or np.any(diagonal < 0) or not np.all(np.isfinite(diagonal)):
            evidence = f"its mass is {value:g} and its diagonal inertia {diagonal.tolist()}"
            raise self._place(prim).error(evidence, "write a mass above 0 and moments of inertia of 0 or more")
        if whole is None:
            axes = mass.GetPrincipalAxesAttr().Get()
            quaternion = np.zeros(4) if axes is None else numbers(axes)
            length = float(np.linalg.norm(quaternion))
            turn = rotation_from_quaternion(quaternion / length) if length > 0 else np.eye(3)  # zero stands for none
            whole = turn @ np.diag(diagonal) @ turn.T
        tensor = whole * self.units.inertia
        return Inertia.from_centre_of_mass(value * self.units.mass, centre * self.units.length, tensor)

    def _parts_of(self, body: Any) -> Iterator[tuple[Any, bool]]:
        """Yield the prims of a body that draw something or touch, and whether they touch; not those of bodies in it."""
        proxies, waiting = pxr_module("Usd").TraverseInstanceProxies(), [(body, False)]
        while waiting:
            prim, touches = waiting.pop()
            if prim.HasAPI(self.physics.CollisionAPI):
                touches = self.physics.CollisionAPI(prim).GetCollisionEnabledAttr().Get() is not False
            if touches or prim.IsA(self.geometry.Gprim):
                yield prim, touches
            children = prim.GetFilteredChildren(proxies)
            waiting += [(child, touches) for child in children if str(child.GetPath()) not in self.rigid]

    def _shapes(self, body: Any) -> tuple[list[Shape], list[Shape]]:
        """Return the shapes of a body that touch, and those that only show it, in the frame of its prim."""
        to_body, found = np.linalg.inv(self._transform(body)), (list[Shape](), list[Shape]())
        for prim, touches in self._parts_of(body):
            if prim.IsA(self.geometry.Gprim):
                check_values(prim, self._place(prim))
                matrix = self._transform(prim) @ to_body
                shape = shape_of(prim, matrix, self.units.length, self._place(prim))
                is_drawn = self.geometry.Imageable(prim).ComputePurpose() in ("default", "render")
                if shape is not None and (touches or is_drawn):
                    found[0 if touches else 1].append(shape)
        return found

    def _gravity(self) -> Array:
        up = np.array([0.0, 1.0, 0.0] if str(self.geometry.GetStageUpAxis(self.stage)) == "Y" else [0.0, 0.0, 1.0])
        if not self.scenes:
            return 0.0 - _GRAVITY * up  # no zero with a sign
        scene = self.physics.Scene(self.scenes[0])
        direction = np.array(scene.GetGravityDirectionAttr().Get(), dtype=float)
        size = float(scene.GetGravityMagnitudeAttr().Get())
        length = float(np.linalg.norm(direction))
        along = direction / length if length > 0 else -up
        return 0.0 + along * (size * self.units.length if 0 <= size < math.inf else _GRAVITY)
