"""Stages of random arms, written with usd-core, and the same arms built in Pinocchio from the numbers of the stage."""

from __future__ import annotations

import importlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.model.joint import rotation_about
from dynident.model.robot import Robot


def single(values: Any) -> Array:
    """Return numbers as the schema holds most of them: rounded to single precision."""
    return np.asarray(np.asarray(values, dtype=np.float32), dtype=float)


def quaternion(random: np.random.Generator) -> Array:
    """Return a random unit quaternion (w, x, y, z) in single precision."""
    value = random.normal(size=4)
    return single(value / np.linalg.norm(value))


@dataclass
class Body:
    """A rigid body in SI units, all numbers as they are on the stage after conversion."""

    mass: float
    centre: Array
    diagonal: Array
    axes: Array


@dataclass
class Hinge:
    """A joint: its kind, bodies by number (-1 the world), frames on body0 and body1, and the letter of its axis."""

    kind: str
    bodies: tuple[int, int]
    frames: tuple[tuple[Array, Array], tuple[Array, Array]]
    axis: str = "Z"
    lower: float = -float("inf")
    upper: float = float("inf")


@dataclass
class Arm:
    """Bodies and joints of a stage; ``length`` and ``mass`` are its units in m and kg."""

    bodies: list[Body] = field(default_factory=list)
    hinges: list[Hinge] = field(default_factory=list)
    length: float = 1.0
    mass: float = 1.0
    up: str = "Z"


def random_arm(seed: int, joints: int, *, length: float = 1.0, mass: float = 1.0, up: str = "Z") -> Arm:
    """Return a tree of joints, some of them fixed, some with the far body as body0, on a body fixed to the world."""
    random = np.random.default_rng(seed)
    arm = Arm(length=length, mass=mass, up=up)

    def frame() -> tuple[Array, Array]:
        return single(random.normal(size=3) * 0.3 / length) * length, quaternion(random)

    for number in range(joints + 1):
        side = single(random.uniform(0.2, 1.0, 3) / (mass * length**2)) * (mass * length**2)
        arm.bodies.append(
            Body(
                float(single(random.uniform(0.5, 3.0) / mass)) * mass,
                single(random.normal(size=3) * 0.1 / length) * length,
                np.array([side[1] + side[2], side[0] + side[2], side[0] + side[1]]),
                quaternion(random),
            )
        )
        arm.bodies[-1].diagonal = single(arm.bodies[-1].diagonal / (mass * length**2)) * (mass * length**2)
        if number == 0:
            arm.hinges.append(Hinge("fixed", (-1, 0), (frame(), frame())))
            continue
        parent = number - 1 if random.random() < 0.7 else int(random.integers(0, number))
        kind = str(random.choice(["revolute", "revolute", "prismatic", "fixed"])) if number > 1 else "revolute"
        pair = (parent, number) if random.random() < 0.6 else (number, parent)
        arm.hinges.append(Hinge(kind, pair, (frame(), frame()), "XYZ"[random.integers(3)]))
    return arm


def _pxr(name: str) -> Any:
    return importlib.import_module(f"pxr.{name}")


def write_stage(path: Path, arm: Arm, gravity: tuple[tuple[float, float, float], float] | None = None) -> None:
    """Write an arm as a stage."""
    Gf, Usd, UsdGeom, UsdPhysics = map(_pxr, ("Gf", "Usd", "UsdGeom", "UsdPhysics"))
    stage: Any = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, arm.length)
    UsdPhysics.SetStageKilogramsPerUnit(stage, arm.mass)
    UsdGeom.SetStageUpAxis(stage, arm.up)
    root = UsdGeom.Xform.Define(stage, "/arm")
    stage.SetDefaultPrim(root.GetPrim())
    UsdPhysics.ArticulationRootAPI.Apply(root.GetPrim())
    scene = UsdPhysics.Scene.Define(stage, "/scene")
    if gravity is not None:
        scene.CreateGravityDirectionAttr(Gf.Vec3f(*gravity[0]))
        scene.CreateGravityMagnitudeAttr(gravity[1])
    for number, body in enumerate(arm.bodies):
        prim = UsdGeom.Xform.Define(stage, f"/arm/body{number}").GetPrim()
        UsdGeom.Xformable(prim).AddTranslateOp().Set(Gf.Vec3d(number, 2.0, -number))  # drawn anywhere
        UsdPhysics.RigidBodyAPI.Apply(prim)
        mass = UsdPhysics.MassAPI.Apply(prim)
        mass.CreateMassAttr(body.mass / arm.mass)
        mass.CreateCenterOfMassAttr(Gf.Vec3f(*(body.centre / arm.length)))
        mass.CreateDiagonalInertiaAttr(Gf.Vec3f(*(body.diagonal / (arm.mass * arm.length**2))))
        mass.CreatePrincipalAxesAttr(Gf.Quatf(*body.axes))
    kinds = {
        "fixed": UsdPhysics.FixedJoint,
        "revolute": UsdPhysics.RevoluteJoint,
        "prismatic": UsdPhysics.PrismaticJoint,
    }
    for number, hinge in enumerate(arm.hinges):
        joint: Any = kinds[hinge.kind].Define(stage, f"/arm/joints/joint{number}")
        for side, rel in enumerate((joint.CreateBody0Rel(), joint.CreateBody1Rel())):
            if hinge.bodies[side] >= 0:
                rel.SetTargets([f"/arm/body{hinge.bodies[side]}"])
        for side, (position, turn) in enumerate(hinge.frames):
            at, rotation = Gf.Vec3f(*(position / arm.length)), Gf.Quatf(*turn)
            (joint.CreateLocalPos0Attr if side == 0 else joint.CreateLocalPos1Attr)(at)
            (joint.CreateLocalRot0Attr if side == 0 else joint.CreateLocalRot1Attr)(rotation)
        if hinge.kind != "fixed":
            joint.CreateAxisAttr(hinge.axis)
            unit = np.degrees(1.0) if hinge.kind == "revolute" else 1.0 / arm.length
            joint.CreateLowerLimitAttr(hinge.lower * unit)
            joint.CreateUpperLimitAttr(hinge.upper * unit)
    stage.GetRootLayer().Save()


def pinocchio_of(arm: Arm, gravity: Array) -> tuple[Any, list[str]]:
    """Return the arm as a model of Pinocchio, whose joint frames are those of the stage, and names of its joints."""
    import pinocchio  # pyright: ignore[reportMissingImports]

    pin: Any = pinocchio

    def place(position: Array, turn: Array) -> Any:
        unit = turn / np.linalg.norm(turn)
        return pin.SE3(pin.Quaternion(*unit), np.array(position))

    model, names = pin.Model(), []
    where = {-1: (0, pin.SE3.Identity())}  # number of the joint that carries a body, and the body in its frame
    waiting = list(enumerate(arm.hinges))
    while waiting:
        number, hinge = next(
            (k, h) for k, h in waiting if h.bodies[0] in where or h.bodies[1] in where
        )  # fmt: skip
        waiting.remove((number, hinge))
        near = 0 if hinge.bodies[0] in where else 1
        child = hinge.bodies[1 - near]
        carrier, body = where[hinge.bodies[near]]
        start = body * place(*hinge.frames[near])
        end = place(*hinge.frames[1 - near]).inverse()  # the child's body in the frame of the joint
        if hinge.kind == "fixed":
            where[child] = (carrier, start * end)
        else:
            axis = np.eye(3)["XYZ".index(hinge.axis)] * (1.0 if near == 0 else -1.0)
            unaligned = {"revolute": pin.JointModelRevoluteUnaligned, "prismatic": pin.JointModelPrismaticUnaligned}[
                hinge.kind
            ]
            joint = model.addJoint(carrier, unaligned(axis), start, f"joint{number}")
            names.append(f"joint{number}")
            where[child] = (joint, end)
        own = arm.bodies[child]
        unit = own.axes / np.linalg.norm(own.axes)
        turn = pin.Quaternion(*unit).toRotationMatrix()
        inertia = pin.Inertia(own.mass, own.centre, turn @ np.diag(own.diagonal) @ turn.T)
        if where[child][0] > 0:
            model.appendBodyToJoint(where[child][0], inertia, where[child][1])
    model.gravity.linear = np.array(gravity)
    return model, names


def arm_of(robot: Robot) -> Arm:
    """Return a robot as converters write it: link frames as prims, the joint's x axis turned to its axis."""

    def quaternion_of(rotation: Array) -> Array:
        from scipy.spatial.transform import Rotation

        return np.roll(Rotation.from_matrix(rotation).as_quat(), 1)

    arm = Arm()
    for link in robot.links:
        assert link.inertia is not None
        values, axes = np.linalg.eigh(link.inertia.about_centre)
        axes = axes * np.sign(np.linalg.det(axes))
        centre = np.asarray(link.inertia.centre_of_mass)
        arm.bodies.append(Body(link.inertia.mass, centre, values, quaternion_of(axes)))
    for number, joint in enumerate(robot.joints):
        cross = np.cross([1.0, 0.0, 0.0], joint.axis)
        length = float(np.linalg.norm(cross))
        turn = (
            rotation_about(cross / length, float(np.arctan2(length, joint.axis[0])))
            if length > 1e-12
            else np.eye(3) if joint.axis[0] > 0 else rotation_about(np.array([0.0, 0.0, 1.0]), np.pi)
        )  # fmt: skip
        frames = (
            (np.array(joint.translation), quaternion_of(joint.rotation @ turn)),
            (np.zeros(3), quaternion_of(turn)),
        )
        limits = joint.limits
        arm.hinges.append(Hinge(joint.kind, (joint.parent, number), frames, "X", limits.lower, limits.upper))
    return arm
