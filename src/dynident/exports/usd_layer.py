"""Identified masses, centres and inertias as a layer over the user's own USD stage; the stage itself stays as it is."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from dynident.diagnosis.verdict import causes_against
from dynident.errors import BadArgument, FileError, NotAccepted
from dynident.exports.models.subject.drives import rigid_torque
from dynident.exports.models.subject.identified import identified
from dynident.exports.models.subject.source import find_source
from dynident.exports.models.subject.states import states_of
from dynident.exports.models.writing.placement import place, shared
from dynident.files import check_outputs, write_atomically
from dynident.identification.estimate.estimate import Estimate
from dynident.model.inertia import Inertia
from dynident.model.kernels import batched
from dynident.robot_files import read_robot
from dynident.robot_files.usd_parts import WHOLE_INERTIA, StageBody, StageUnits, open_stage, pxr_module, whole_inertia
from dynident.robot_files.usd_stage import read_stage

#: Largest difference of torques as a share of the largest of the joint: the schema holds single precision.
_LARGEST: Final = 1e-5

#: Mass in kg and moment of inertia in kg m^2 of a body whose inertia has gone to the link that carries it.
_LEAST_MASS, _LEAST_INERTIA = 1e-6, 1e-9

#: Places of the six numbers of ``newton:inertia``.
_WHOLE: Final = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))

_ENDINGS: Final = (".usd", ".usda", ".usdc", ".usdz")


@dataclass(frozen=True)
class UsdLayer:
    """A layer that was written.

    Attributes:
        path: Its file, which names the stage as its sublayer.
        stage: The user's stage.
        relative: Largest difference of torques when it was read again, as a share of the largest of the joint.
        notes: What the reader has to know.
    """

    path: str
    stage: str
    relative: float
    notes: tuple[str, ...]


def write_usd_layer(
    estimate: Estimate, path: str | Path, *, stage: str | Path | None = None, force: bool = False
) -> UsdLayer:
    """Write a USD layer that gives the bodies of the user's stage their identified mass, centre of mass and inertia.

    The layer has the stage as its sublayer, by its relative path; open the layer in place of the stage. Friction,
    rotor inertia and drives are left as the stage has them. It is read again and torques are compared.

    Args:
        estimate: The estimate.
        path: The file to write, ending with ``.usda``.
        stage: The stage that was identified; None for the robot model that the estimate names.
        force: Write an estimate that findings of the log checks at error level speak against.

    Raises:
        BadArgument: No stage, or a path that does not end with ``.usda``.
        MissingDependency: OpenUSD (usd-core) is not installed.
        NotAccepted: Findings of the log checks at error level speak against the estimate.
        NotConsistent: No physically consistent robot has the base parameters of the estimate.
        DescriptionError: The stage is faulty, or of another robot.
        FileError: The torques differ when it is read again, or it cannot be written.
    """
    target = Path(path)
    if target.suffix.lower() != ".usda":
        raise BadArgument("path", f"'{path}'", "give a file that ends with .usda")
    for cause in () if force else causes_against(estimate):
        raise NotAccepted("the estimate is not accepted", str(cause), "correct it, or give force=True")
    source = find_source(estimate, stage)
    if source is None or source.path.suffix.lower() not in _ENDINGS:
        told = "no robot model file was given or found" if source is None else f"{source.path} is no USD"
        raise BadArgument("stage", told, 'give the stage that was identified: stage="robot.usd"')
    check_outputs((str(target),), (source.path,))
    subject, parts = identified(estimate, source), read_stage(source.path)
    placement = place(source.path, subject.model.robot, parts.inertias, parts.connections)
    shares = shared(subject.model.robot, subject.bodies, placement, lump=False)
    composed = _layer_over(source.path)
    notes = list(shares.notes)
    for name, inertia in shares.inertias.items():
        if inertia is None:
            notes.append(f"{name} has {_LEAST_MASS:g} kg: its inertia is in the link that carries it")
        _set_mass(composed, source.path, parts.bodies[name], inertia, parts.units)
    own, named = os.path.abspath(source.path), Path(os.path.relpath(source.path, target.parent)).as_posix()
    text = str(composed.GetRootLayer().ExportToString())
    states = states_of(subject.model, placement.locked)
    relative = _difference(text, placement.locked, rigid_torque(subject, states.motion), states.motion, subject)
    if not relative <= _LARGEST:
        step = "report it with the estimate: nothing was written"
        raise FileError(target, f"read again, its torques differ by {relative:.2g}", step)
    write_atomically(target, text.replace(f"@{own}@", f"@{named if named.startswith('.') else f'./{named}'}@"))
    return UsdLayer(str(target), str(source.path), relative, tuple(notes))


def _layer_over(path: Path) -> Any:
    """Return a stage of a new layer over a stage, with its units, up axis and default prim."""
    base, layers, engine = open_stage(path), pxr_module("Sdf"), pxr_module("Usd")
    geometry, physics = pxr_module("UsdGeom"), pxr_module("UsdPhysics")
    layer = layers.Layer.CreateAnonymous(".usda")
    layer.subLayerPaths.append(os.path.abspath(path))
    layer.comment = "Identified masses, centres of mass and inertias, by dynident"
    stage = engine.Stage.Open(layer)
    geometry.SetStageUpAxis(stage, geometry.GetStageUpAxis(base))
    geometry.SetStageMetersPerUnit(stage, geometry.GetStageMetersPerUnit(base))
    physics.SetStageKilogramsPerUnit(stage, physics.GetStageKilogramsPerUnit(base))
    if base.GetDefaultPrim():
        stage.SetDefaultPrim(stage.GetPrimAtPath(base.GetDefaultPrim().GetPath()))
    return stage


def _set_mass(stage: Any, path: Path, body: StageBody, inertia: Inertia | None, units: StageUnits) -> None:
    """Write mass, centre of mass, diagonal inertia and principal axes of a body."""
    from scipy.spatial.transform import Rotation

    prim, values = stage.GetPrimAtPath(body.prim), pxr_module("Gf")
    if prim.IsInstanceProxy():
        step = "set instanceable = false on the prim above it: instances share their values"
        raise FileError(path, f"{body.prim} is in an instance", step)
    mass, centre, diagonal, axes = _LEAST_MASS, np.zeros(3), np.full(3, _LEAST_INERTIA), np.eye(3)
    if inertia is not None:
        own = inertia.moved(np.eye(3), body.shift)  # about the origin of the prim
        mass, centre = own.mass, np.asarray(own.centre_of_mass)
        diagonal, axes = np.linalg.eigh(own.about_centre)
        axes = axes * np.sign(np.linalg.det(axes))
    x, y, z, w = Rotation.from_matrix(axes).as_quat()
    schema = pxr_module("UsdPhysics").MassAPI.Apply(prim)
    schema.CreateMassAttr().Set(mass / units.mass)
    schema.CreateCenterOfMassAttr().Set(values.Vec3f(*(centre / units.length).tolist()))
    schema.CreateDiagonalInertiaAttr().Set(values.Vec3f(*(diagonal / units.inertia).tolist()))
    schema.CreatePrincipalAxesAttr().Set(values.Quatf(float(w), float(x), float(y), float(z)))
    if whole_inertia(prim) is not None:  # it would go before the diagonal
        tensor = axes @ np.diag(diagonal / units.inertia) @ axes.T
        prim.GetAttribute(WHOLE_INERTIA).Set([float(tensor[i, j]) for i, j in _WHOLE])


def _difference(text: str, locked: Any, expected: Any, motion: Any, subject: Any) -> float:
    """Return the largest difference of torques of the layer read again, as a share of the largest of the joint."""
    import tempfile

    with tempfile.TemporaryDirectory(prefix="dynident-") as folder:
        file = Path(folder) / "again.usda"
        file.write_text(text, encoding="utf-8", newline="\n")
        robot = read_robot(file)
    robot = robot.locked(locked) if locked else robot
    order = [robot.joint_names.index(name) for name in subject.model.robot.joint_names]
    back = np.argsort(order)
    nominal = robot.nominal
    assert nominal is not None
    robot = robot.with_gravity(subject.model.robot.gravity)
    states = (motion.q[:, back], motion.dq[:, back], motion.ddq[:, back])
    found = batched.inverse_dynamics(robot.chain, nominal, *states)[:, order]
    size = np.abs(expected).max(axis=0)
    return float((np.abs(found - expected).max(axis=0) / np.maximum(size, 1e-6 * size.max())).max())
