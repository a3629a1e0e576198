"""Finished starts of an excitation design in a file, so that a search can go on where it was stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynident.errors import BadOption, FileError
from dynident.excitation.criteria import CRITERIA
from dynident.excitation.design.design_problem import DesignProblem
from dynident.excitation.design.finishing import FinishingCandidate
from dynident.excitation.design.start import StartResult
from dynident.file_versions import FileVersions
from dynident.files import DAMAGE, read_json, write_atomically
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.friction import FRICTION

KIND = "dynident search"

#: Files of finished starts.
VERSIONS = FileVersions("a search")

#: Goes up when the same start of the same problem gives another motion.
SEARCH = 1


@dataclass(frozen=True)
class DesignCheckpoint:
    """A file that keeps the starts of one problem and one seed.

    Attributes:
        path: The file.
        facts: What the starts depend on, each as a hash, by name.
        size: Number of free numbers of a motion, n m.
    """

    path: str | Path
    facts: Mapping[str, str]
    size: int

    def read(self) -> dict[int, StartResult]:
        """Return the finished starts by number; none where there is no file yet.

        Raises:
            FileError: The file is none of this kind, damaged, or of another problem.
        """
        step = "give another file, or remove this one to search anew"
        if not Path(self.path).exists():
            return {}
        data = read_json(self.path, step, FileError)
        if not isinstance(data, dict) or data.get("kind") != KIND:
            raise FileError(self.path, "no search", step)
        data = VERSIONS.migrated(data, lambda evidence, advice: FileError(self.path, evidence, advice))
        kept = data.get("problem")
        if kept != dict(self.facts):
            names = [name for name, own in self.facts.items() if not isinstance(kept, dict) or kept.get(name) != own]
            evidence = f"these starts are of another problem; different: {', '.join(names) or 'its parts'}"
            raise FileError(self.path, evidence, f"give the options of that search, or {step}")
        try:
            return {int(number): self._result(int(number), own) for number, own in data["starts"].items()}
        except DAMAGE as error:
            raise FileError(self.path, f"damaged ({type(error).__name__}: {error})", step) from error

    def write(self, results: Mapping[int, StartResult]) -> None:
        """Write all finished starts; the old file or the new one is there, never half of one.

        Raises:
            FileError: The file cannot be written.
        """
        starts = {str(number): _data(results[number]) for number in sorted(results)}
        data = {"kind": KIND, "format": VERSIONS.current, "problem": dict(self.facts), "starts": starts}
        write_atomically(self.path, json.dumps(data, allow_nan=False) + "\n")

    def _result(self, number: int, data: Mapping[str, Any]) -> StartResult:
        found = []
        for item in data["candidates"]:
            free = np.array(item["free"], dtype=np.float64)
            if free.shape != (self.size,) or not np.all(np.isfinite(free)) or number < 1:
                raise ValueError(f"start {number} has no {self.size} finite numbers")
            found.append(FinishingCandidate(free, float(item["figure"]), number))
        return StartResult(number, tuple(found), int(data["evaluations"]), True)


def _data(result: StartResult) -> dict[str, Any]:
    candidates = [{"free": one.free.tolist(), "figure": one.figure} for one in result.candidates]
    return {"candidates": candidates, "evaluations": result.evaluations}


def problem_facts(problem: DesignProblem, seed: int) -> dict[str, str]:
    """Return the hash of everything that the starts of a problem and a seed depend on, by name."""
    model, part, shape = problem.observation.model, problem.criterion, problem.parametrisation
    facts: dict[str, object] = {
        "search": SEARCH,
        "robot": robot_to_dict(model.robot),
        "friction": [(FRICTION.name_of(item), _plain(item)) for item in model.friction],
        "criterion": (CRITERIA.name_of(part), _plain(part)),
        "trajectory": (shape.kind, shape.period, shape.harmonics),
        "samples": problem.samples,
        "limits": _plain(problem.limits),
        "noise": _plain(problem.noise),
        "torque parameters": _plain(problem.theta),
        "torque uncertainty": _plain(problem.uncertainty),
        "clearance": _plain(problem.clearance),
        "tool speed": _plain(problem.tool),
        "earlier runs": _plain(problem.earlier),
        "seed": seed,
    }
    return {name: hashlib.sha256(json.dumps(fact).encode()).hexdigest()[:16] for name, fact in facts.items()}


def _plain(value: object) -> object:
    """Return a value as plain data that is the same for equal values, in this and in every other process.

    Raises:
        BadOption: A value that is neither plain data nor a dataclass of plain data.
    """
    if value is None or isinstance(value, str | int | float | bool):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    step = "its parts are no plain values, so a search with it cannot be resumed; leave the checkpoint out"
    raise BadOption("checkpoint", type(value).__name__, step)
