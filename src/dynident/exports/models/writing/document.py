"""The model as one JSON document, exact to the last bit: the export ``json``, and what stands beside other files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from dynident.arrays import Array, frozen
from dynident.errors import DynidentError, EstimateFormatError
from dynident.exports.models.subject.drives import Drives, Term
from dynident.exports.models.subject.identified import NONE, Identified
from dynident.exports.models.writing.xml_edit import check_printable
from dynident.file_versions import FileVersions
from dynident.files import DAMAGE, bytes_of
from dynident.identification.consistency.labels import labels_of
from dynident.identification.estimate.estimate import Estimate
from dynident.model.documents.robot_data import robot_from_dict, robot_to_dict
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.robot_files.tree import some

#: Kind that every document states, and its versions.
KIND: Final = "dynident model"
VERSIONS: Final = FileVersions("a model")


def document(subject: Identified, drives: Drives) -> dict[str, Any]:
    """Return the model as plain data: robot, friction, parameters with covariance, and drives as simulators hold them.

    A document without standard parameters says so by ``null``: no possible robot has its base parameters.
    """
    estimate = subject.estimate
    return {
        "kind": KIND,
        "format": VERSIONS.current,
        "robot": robot_to_dict(subject.model.robot),
        "friction": [
            {FRICTION.name_of(part): {k: v for k, v in asdict(part).items() if v is not None}}
            for part in subject.model.friction
        ],
        "base_parameters": {
            "names": list(estimate.base.names),
            "units": list(estimate.base.units),
            "values": estimate.beta.tolist(),
            "covariance": estimate.covariance.tolist(),
            "degrees_of_freedom": _finite(estimate.degrees),
            "combination": estimate.base.matrix.tolist(),
        },
        "standard_parameters": None if subject.origin == NONE else _standard(subject),
        "drives": {
            "joints": list(drives.joints),
            "coupling": np.asarray(drives.coupling).tolist(),
            "armature": drives.armature.tolist(),
            "damping": drives.damping.tolist(),
            "friction": drives.dry.tolist(),
            "rest": [term.data() for term in drives.rest],
        },
        "estimator": estimate.estimator,
        "samples": estimate.samples,
        "versions": {k: v for k, v in estimate.provenance.items() if isinstance(v, str) and k != "command"},
    }


def _standard(subject: Identified) -> dict[str, Any]:
    estimate, parameters = subject.estimate, subject.model.parameters
    own = labels_of(estimate) if estimate.theta is not None and subject.theta is estimate.theta else ()
    return {
        "names": [parameter.name for parameter in parameters],
        "units": [parameter.unit for parameter in parameters],
        "values": subject.theta.tolist(),
        "verdicts": list(estimate.base.verdicts),
        "labels": [label.word for label in own] or None,
        "origin": subject.origin,
    }


def _finite(values: Array | None) -> list[float | None] | None:
    return None if values is None else [float(v) if np.isfinite(v) else None for v in values]


def document_bytes(subject: Identified, drives: Drives) -> bytes:
    """Return the text of the document, plain ASCII.

    Raises:
        BadOption: A name that no reader of robot models takes.
    """
    robot = subject.model.robot
    check_printable("robot", [robot.name, robot.base])
    check_printable("link", [link.name for link in robot.links])
    check_printable("joint", [joint.name for joint in robot.joints])
    return (json.dumps(document(subject, drives), indent=1, allow_nan=False) + "\n").encode("ascii")


def read_document(path: str | Path, data: bytes | None = None) -> tuple[DynamicModel, Array, bool]:
    """Return the model of a document, its parameters, and whether they are standard (p,) or base parameters (b,).

    Raises:
        FileError: The file cannot be read.
        EstimateFormatError: It is no such document, damaged, or of another format.
    """
    data = bytes_of(path) if data is None else data
    step = "give a file that 'dynident export --to json' has written"
    try:
        found: Any = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise EstimateFormatError(path, f"no JSON that can be read ({error})", step) from error
    if not isinstance(found, dict) or found.get("kind") != KIND:
        raise EstimateFormatError(path, "no exported model", step)
    found = VERSIONS.migrated(found, lambda evidence, advice: EstimateFormatError(path, evidence, advice))
    try:
        return _model(found, path)
    except (*DAMAGE, DynidentError) as error:
        raise EstimateFormatError(path, f"damaged ({type(error).__name__}: {error})", "export it again") from error


def _model(found: Mapping[str, Any], path: object) -> tuple[DynamicModel, Array, bool]:
    parts = [
        FRICTION.make(name, {k: tuple(v) if isinstance(v, list) else v for k, v in options.items()})
        for item in found["friction"]
        for name, options in item.items()
    ]
    model = DynamicModel(robot_from_dict(found["robot"], path), tuple(parts))
    standard = found["standard_parameters"]
    if standard is None:
        values = found["base_parameters"]["values"]
        return model, frozen(values, (len(found["base_parameters"]["names"]),), "values"), False
    return model, frozen(standard["values"], (len(model.parameters),), "values"), True


def base_torque(estimate: Estimate, beta: Array, states: Any) -> Array:
    """Return the torque of base parameters (b,) on a motion, shape (N, n): Y of the kept columns, and what is known."""
    model = estimate.model
    motion = model.loaded(states, estimate.base.to_standard(beta))
    return model.regressor(motion)[..., estimate.base.independent] @ beta + model.known_torque(motion)


def place_beside(path: Path) -> Path:
    """Return where the document of a model stands beside an exported file."""
    return path.with_name(f"{path.name}.dynident.json")


def left_out(drives: Drives, *, armature: bool, coupled: bool, springs: Sequence[Term] = ()) -> tuple[Term, ...]:
    """Return the coefficients that a format cannot hold.

    Args:
        drives: The drives.
        armature: Whether it holds rotor inertias.
        coupled: Whether it holds drives that turn several joints.
        springs: Those of ``Drives.springs`` that it holds.
    """
    rest = tuple(term for term in drives.rest if term not in springs)
    rotors: list[Term] = []
    if not armature:
        alone = drives.alone if not coupled else drives.alone | True
        rotors = [
            drives.term(j, "armature", float(drives.armature[j])) for j in np.flatnonzero(drives.armature * alone)
        ]
    return (*rotors, *(() if coupled else drives.coupled_rest()), *rest)


def friction_notes(drives: Drives, target: str) -> tuple[str, ...]:
    """Return what damping and Coulomb friction of a target stand for, which has the sharp sign and no other part."""
    curves = [name for name, is_nearest in zip(drives.joints, drives.nearest, strict=True) if is_nearest]
    near = f"damping and Coulomb friction of {some(curves)} are those nearest to all parts of the friction in the logs"
    nearest = (near,) if curves else ()
    if not drives.dry.any():
        return nearest
    return (
        *nearest,
        f"Coulomb friction is sharp at standstill in {target}, and tanh(dq / width) in the model where a width was "
        "set: torques differ below a few widths of speed",
    )
