"""The robot model that a model goes back into: found, read, and kept byte by byte."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from dynident.errors import DynidentError
from dynident.files import sha256_of
from dynident.identification.estimate.estimate import Estimate
from dynident.robot_files.reading import format_name, robot_text
from dynident.robot_files.xacro import with_arguments

#: Ending of the file for each exporter that writes into a robot model.
_ENDINGS: Final = {"urdf": ".urdf", "mjcf": ".xml", "sdf": ".sdf", "usd": ".usda"}


@dataclass(frozen=True)
class OwnDescription:
    """A robot model.

    Attributes:
        path: Its file.
        data: Its bytes.
        note: What is to be said about how it was found; empty for nothing.
    """

    path: Path
    data: bytes
    note: str = ""

    @property
    def kind(self) -> str:
        """Its format: ``urdf``, ``mjcf`` and so on; empty where it is none that is known."""
        try:
            return format_name(self.path, self.data)
        except DynidentError:
            return ""

    @property
    def is_urdf(self) -> bool:
        """Whether it is a URDF."""
        return self.kind == "urdf"


class OwnTarget(NamedTuple):
    """What writes into a robot model: the name of an exporter, and how its file ends."""

    name: str
    ending: str


def find_source(estimate: Estimate, path: str | Path | None) -> OwnDescription | None:
    """Return the robot model of a user: the one given, or the one that the estimate's provenance names.

    The provenance names the robot model itself or the case file that does. One that is not there any more, or has
    changed, is passed over: the model is then exported without it.

    Raises:
        FileError: The file given cannot be read.
        DescriptionError: It is a xacro that cannot be expanded.
    """
    if path is not None:
        return _own(str(path))
    facts = estimate.provenance.get("robot")
    if isinstance(facts, dict) and _unchanged(facts):
        return _own(with_arguments(facts["path"], facts.get("arguments", {})), f"robot model: {facts['path']}")
    case = estimate.provenance.get("case")
    if not isinstance(case, dict) or not _unchanged(case):
        return None
    from dynident.case.case import read_case

    try:
        found = read_case(case["path"]).robot_path
        return _own(found, f"robot model: {found}, named by {case['path']}")
    except DynidentError:  # a shipped robot, a file that was moved: there is nothing to go back into
        return None


def own_target(estimate: Estimate) -> OwnTarget:
    """Return the exporter that writes into the robot model that was identified.

    A robot model of another kind, or one that is not there any more, has ``urdf``.
    """
    try:
        source = find_source(estimate, None)
    except DynidentError:  # a xacro that cannot be expanded any more
        source = None
    kind = source.kind if source is not None and source.kind in _ENDINGS else "urdf"
    return OwnTarget(kind, _ENDINGS[kind])


def _unchanged(facts: dict[str, str]) -> bool:
    file = Path(str(facts.get("path", "")))
    try:
        return file.is_file() and sha256_of(file) == facts.get("sha256")
    except DynidentError:
        return False


def _own(name: str, note: str = "") -> OwnDescription:
    """Return a robot model; of a xacro the URDF that it stands for."""
    found = robot_text(name)
    if found.is_expanded:
        told = f"{found.path} is a xacro, whose numbers are expressions: it is not changed, its expanded URDF is"
        note = f"{note}; {told}" if note else told
    return OwnDescription(Path(found.called), found.data, note)
