"""Drake: model directives and the SDF that they add, with the base welded to the world."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar
from xml.etree.ElementTree import ParseError

import numpy as np
from defusedxml import DefusedXmlException, ElementTree

from dynident.errors import FileError
from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.proving.robot_model_proof import sdf_by_drake, sdf_by_reader
from dynident.exports.models.subject.drives import Drives, Term, drives_of
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import StateSet
from dynident.exports.models.writing.document import document_bytes, left_out, place_beside
from dynident.exports.models.writing.sdf_text import base_name, base_note, sdf_text
from dynident.exports.names_in_files import comment_text

_PACKAGE = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
_PACKAGE_FILE = "package.xml"


@dataclass(frozen=True)
class Drake(ModelExporter):
    """Drake: model directives (FILE), the SDF with reflected inertia that they add and weld, and its package.xml.

    Attributes:
        package: Name of the package, whose folder is that of FILE; none: that of the package.xml there, or FILE's own.
    """

    package: str = ""

    suffix: ClassVar[str] = ".dmd.yaml"
    proof: ClassVar[str] = "bodies, armature and damping by Drake, and with Coulomb friction by dynident"

    def content(self, subject: Identified, path: Path) -> ModelContent:
        drives, package = drives_of(subject), self._package(path)
        sdf, about = _sdf_place(path), path.with_name(_PACKAGE_FILE)
        if path in (sdf, about):
            raise FileError(path, "a file beside the directives has this name", "call it NAME.dmd.yaml")
        files = {
            path: self._directives(subject, package, sdf),
            sdf: sdf_text(subject, drives),
            about: _package_file(about, package),
            place_beside(path): document_bytes(subject, drives),
        }
        notes = [f"tell Drake where the package is: package_map().AddPackageXml('{about.name}')"]
        notes.append("gravity is that of the plant; Drake has no Coulomb friction of joints")
        notes += base_note(subject)
        if any(joint.mimic is not None for joint in subject.model.robot.joints):
            notes.append("joints that follow another move freely")
        return ModelContent(files, (*_dry_terms(drives), *left_out(drives, armature=True, coupled=False)), tuple(notes))

    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: StateSet) -> Iterator[Reloaded]:
        path = folder / next(iter(content.files)).name
        yield sdf_by_reader(subject, _sdf_place(path), states)
        yield sdf_by_drake(subject, path, states, self._package(path))

    def _package(self, path: Path) -> str:
        name = self.package or _name_in(path.with_name(_PACKAGE_FILE)) or path.name.split(".")[0]
        if not _PACKAGE.fullmatch(name):
            step = "use letters, digits, '_' and '-', a letter first; --option package=NAME gives another one"
            raise FileError(path, f"'{name}' cannot name a package", step)
        return name

    def _directives(self, subject: Identified, package: str, sdf: Path) -> bytes:
        model = json.dumps(subject.model.robot.name)
        base = json.dumps(f"{subject.model.robot.name}::{base_name(subject.model.robot)}")
        lines = [
            "directives:",
            "- add_model:",
            f"    name: {model}",
            f"    file: {json.dumps(f'package://{package}/{sdf.name}')}",
            "- add_weld:",
            "    parent: world",
            f"    child: {base}",
        ]
        return ("\n".join(lines) + "\n").encode("ascii")


def _sdf_place(path: Path) -> Path:
    return path.with_name(f"{path.name.split('.')[0]}.sdf")


def _package_file(path: Path, package: str) -> bytes:
    """Return the package file, that of a ROS package as it is: a build needs the rest of it.

    Raises:
        FileError: There is one of another package.
    """
    if not path.exists():
        return f'<package format="2"><name>{package}</name></package>\n'.encode("ascii")
    if (name := _name_in(path)) != package:
        evidence = f"it is of the package '{comment_text(name)}', not '{package}'" if name else "it names no package"
        raise FileError(path, evidence, "leave --option package out, or export to a folder of its own")
    return path.read_bytes()


def _name_in(path: Path) -> str:
    """Return the name of the package that a package.xml states; empty where there is no such file or name."""
    try:
        data = path.read_bytes()
    except OSError:
        return ""
    try:
        return (ElementTree.fromstring(data).findtext("name") or "").strip()
    except (ParseError, DefusedXmlException, ValueError):
        return ""


def _dry_terms(drives: Drives) -> tuple[Term, ...]:
    dry = drives.at_joints()[2]
    return tuple(drives.term(j, "friction", float(dry[j])) for j in np.flatnonzero(dry))
