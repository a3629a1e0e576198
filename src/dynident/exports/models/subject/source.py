"""The robot model that a model goes back into: found, read, and kept byte by byte."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from dynident.errors import DynidentError
from dynident.identification.estimate.estimate import Estimate
from dynident.robot_files.formats.base import DESCRIPTIONS
from dynident.robot_files.reading import format_name, format_of, robot_text
from dynident.robot_files.robot_origin import is_unchanged
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
    """What writes into a robot model: an exporter, how its file ends, and whether the robot model has to be given."""

    name: str
    ending: str
    is_lost: bool = False


def find_source(estimate: Estimate, path: str | Path | None) -> OwnDescription | None:
    """Return the robot model of a user: the one given, or the one that the estimate's provenance names.

    The provenance names the robot model itself or the case file that does, from the folder of the identification or of
    the estimate. One that is not there any more, or has changed, is passed over: the model is then exported without it.

    Raises:
        FileError: The file given cannot be read.
        DescriptionError: It is a xacro that cannot be expanded.
    """
    if path is not None:
        return _own(str(path))
    facts = estimate.provenance.get("robot")
    if isinstance(facts, dict) and (file := _unchanged(facts, estimate.file)):
        return _own(with_arguments(file, facts.get("arguments", {})), f"robot model: {file}")
    case = estimate.provenance.get("case")
    if not isinstance(case, dict) or not (file := _unchanged(case, estimate.file)):
        return None
    from dynident.case.case import read_case

    try:
        found = read_case(file).robot_path
        return _own(found, f"robot model: {found}, named by {file}")
    except DynidentError:  # a shipped robot, a file that was moved: there is nothing to go back into
        return None


def files_of(source: OwnDescription | None) -> tuple[str, ...]:
    """Return the files of a robot model of a user: the main one, and its includes."""
    if source is None:
        return ()
    found: tuple[str, ...] = ()
    with suppress(DynidentError):
        found = format_of(source.path, source.data).included(source.path, source.data)
    return (str(source.path), *found)


def anew_note(source: OwnDescription | None, estimate: Estimate, noun: str) -> tuple[str, ...]:
    """Return the sentence on a file that is new since the robot model of the user was not found; none where it was."""
    if source is not None:
        return ()
    name = _name(estimate)
    lost = f" ({name}, which was identified, is not there or has changed, or an include of it)" if name else ""
    return (
        f"no robot model file was given or found{lost}: the {noun} is new, without meshes; --description FILE changes "
        "the inertias of your own",
    )


def own_target(estimate: Estimate) -> OwnTarget:
    """Return the exporter that writes into the robot model that was identified.

    One that is not found has the exporter of its ending; a robot model of another kind has ``urdf``.
    """
    try:
        source = find_source(estimate, None)
    except DynidentError:  # a xacro that cannot be expanded any more
        source = None
    name = _name(estimate)
    kind = _kind_by_ending(name) if source is None else source.kind
    if kind not in _ENDINGS:
        return OwnTarget("urdf", _ENDINGS["urdf"])
    return OwnTarget(kind, _ENDINGS[kind], source is None)


def _name(estimate: Estimate) -> str:
    """Return the name of the robot model that the estimate names; empty for none."""
    facts = estimate.provenance.get("robot")
    return str(facts.get("path", "")) if isinstance(facts, dict) else ""


def _kind_by_ending(name: str) -> str:
    """Return the format that the ending of a name stands for; empty for none."""
    suffix = Path(name).suffix.lower()
    kinds = (kind for kind in DESCRIPTIONS.names() if suffix in DESCRIPTIONS.get(kind).suffixes)
    return next(kinds, "")


def _unchanged(facts: dict[str, Any], estimate_file: str) -> str:
    """Return where a file of the provenance is, with the bytes that it and its includes had; empty for nowhere.

    Its path is relative to where the identification ran, which is often the folder of the estimate or one above.
    """
    name = str(facts.get("path", ""))
    home = Path(estimate_file).absolute().parent
    folders = (home, *home.parents) if estimate_file else ()
    for place in dict.fromkeys((name, *(str(folder / name) for folder in folders if name))):
        if os.path.isfile(place) and is_unchanged(facts, place):
            return place
    return ""


def _own(name: str, note: str = "") -> OwnDescription:
    """Return a robot model; of a xacro the URDF that it stands for."""
    found = robot_text(name)
    if found.is_expanded:
        told = f"{found.path} is a xacro, whose numbers are expressions: it is not changed, its expanded URDF is"
        note = f"{note}; {told}" if note else told
    return OwnDescription(Path(found.called), found.data, note)
