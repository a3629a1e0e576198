"""The proof of an export: its files loaded again, torques compared, the largest differences told."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.errors import DynidentError, FileError
from dynident.files import written_for_a_while
from dynident.results.model_exporters.base import ModelContent, ModelExporter, Reloaded
from dynident.results.model_exporters.subject.drives import Term, drives_of, rigid_torque
from dynident.results.model_exporters.subject.identified import NONE, Identified
from dynident.results.model_exporters.subject.states import states_of

#: A joint whose largest torque is below this share of the robot's is compared with that share.
SMALL = 1e-6


@dataclass(frozen=True)
class Proof:
    """What one engine made of the files.

    Attributes:
        engine: Its name with its version.
        what: What was compared.
        states: Number of random states; 0 where the engine was not asked.
        difference: Largest difference of a torque, in N m or N; None where the engine was not asked.
        relative: Largest difference over the largest torque of its joint; None where the engine was not asked.
        why_not: Why the engine was not asked; empty where it was.
        allowed: Largest relative difference with which files are written.
    """

    engine: str
    what: str
    states: int
    difference: float | None
    relative: float | None
    why_not: str
    allowed: float


@dataclass(frozen=True)
class ModelExport:
    """What an export of a model wrote, or would write.

    Attributes:
        exporter: Name of the exporter.
        robot: Name of the robot.
        estimator: Method of the estimate.
        parameters: Where the standard parameters are from: of the estimate, chosen behind its base parameters, none.
        files: The files, the one that was named first.
        proofs: What each engine made of them.
        left_out: Coefficients that the first file cannot hold; the file beside it has them.
        neglected: Largest torque of what the first file cannot hold, smooth signs included, by joint, in N m or N, on
            the states of the proof; empty where it holds everything.
        notes: What the reader has to know.
    """

    exporter: str
    robot: str
    estimator: str
    parameters: str
    files: tuple[str, ...]
    proofs: tuple[Proof, ...]
    left_out: tuple[Term, ...]
    neglected: Mapping[str, float]
    notes: tuple[str, ...]


def model_export_data(export: ModelExport) -> dict[str, Any]:
    """Return an export as plain data: what ``dynident export --json`` prints."""
    data = asdict(export)
    for key in ("files", "notes", "proofs", "left_out"):
        data[key] = list(data[key])
    return data | {"neglected": dict(export.neglected)}


def proofs_of(part: ModelExporter, subject: Identified, content: ModelContent, target: Path) -> tuple[Proof, ...]:
    """Load files that are not written yet in every engine, and compare torques.

    Raises:
        FileError: An engine cannot load them, or its torques differ by more than is allowed, a millionth as a rule.
    """
    step = "report it with the estimate: nothing was written"
    found: list[Proof] = []
    with tempfile.TemporaryDirectory(prefix="dynident-") as name:
        folder = Path(name)
        with written_for_a_while():
            for file, data in content.files.items():
                (folder / file.name).write_bytes(data)
        try:
            for one in part.reload(subject, content, folder, states_of(subject.model)):
                found.append(_proof(one))
                last = found[-1]
                if last.relative is not None and not last.relative <= last.allowed:
                    evidence = f"{last.engine} gives torques that differ by {last.relative:.2g} ({last.what})"
                    raise FileError(target, evidence, step)
        except DynidentError:
            raise
        except Exception as error:  # an engine of others may raise anything
            reason = " ".join(str(error).split())[:200]
            raise FileError(target, f"an engine cannot load it again ({reason})", step) from error
    return tuple(found)


def _proof(one: Reloaded) -> Proof:
    if one.torque is None or one.expected is None:
        return Proof(one.engine, one.what, 0, None, None, one.why_not, one.largest)
    away = np.abs(one.torque - one.expected).max(axis=0)
    largest = np.abs(one.expected).max(axis=0)
    size = np.maximum(largest, SMALL * largest.max(initial=0.0))
    relative = np.divide(away, size, out=np.where(away > 0, np.inf, 0.0), where=size > 0)
    return Proof(one.engine, one.what, len(one.torque), float(away.max()), float(relative.max()), "", one.largest)


def neglected_torque(subject: Identified, left_out: tuple[Term, ...]) -> dict[str, float]:
    """Return the largest torque of each joint that a format with some coefficients missing does not give."""
    if subject.origin == NONE or not left_out:
        return {}
    motion = states_of(subject.model).motion
    drives = drives_of(subject)
    symbols = {(term.joint, term.part) for term in left_out}
    rotors = any(part == "rotor_inertia" and drives.alone[drives.joints.index(j)] for j, part in symbols)
    coupled = not any(term in left_out for term in drives.coupled_rest())
    dry = not any(part == "coulomb" and drives.alone[drives.joints.index(j)] for j, part in symbols)
    held = rigid_torque(subject, motion) + drives.torque(motion, armature=not rotors, coupled=coupled, dry=dry)
    rest = _largest(subject.model.torque(motion, subject.theta) - held)
    return dict(zip(subject.model.robot.joint_names, rest, strict=True))


def _largest(torque: Array) -> list[float]:
    return np.abs(torque).max(axis=0).tolist()
