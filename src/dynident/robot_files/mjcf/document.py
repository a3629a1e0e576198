"""An MJCF file with its includes as one tree, its sections, and the settings of its compiler."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Final

import numpy as np

from dynident.arrays import Array
from dynident.errors import DescriptionError
from dynident.model.documents.numbers import Place, shown
from dynident.robot_files.mjcf.schema import check_schema
from dynident.robot_files.xml_elements import Element, Values, XmlLanguage, parse_xml

#: Largest file that is included.
MAX_BYTES: Final = 20_000_000
MAX_FILES: Final = 200

#: Sections that say nothing of bodies and joints: passed over.
_PASSED: Final = frozenset("size visual statistic extension custom sensor keyframe".split())
#: What MuJoCo calls a model without a name.
_UNNAMED: Final = "MuJoCo Model"
_LANGUAGE: Final = XmlLanguage("MJCF", ("mujoco", "mujocoinclude"), "body")
_INCLUDED: Final = XmlLanguage("MJCF", ("mujoco", "mujocoinclude"), "body")


@dataclass(frozen=True)
class CompilerSettings:
    """Settings of the compiler of a model, as MuJoCo has them by default.

    Attributes:
        degrees: Whether angles are in degrees.
        sequence: Axes of Euler angles.
        autolimits: Whether a range alone makes a limit.
        from_geoms: ``"auto"``, ``"true"`` or ``"false"``: when bodies get their inertia from their geoms.
        groups: First and last group of the geoms that count for it.
        least_mass: Lower bound of masses, in kg.
        least_inertia: Lower bound of principal moments of inertia, in kg m^2.
        balances: Whether impossible principal moments are replaced by their mean.
        total_mass: What all masses together are scaled to, in kg; none where it is not above 0.
        exact_meshes: Whether meshes are taken for exact ones unless they say how.
        mesh_folder: Folder of the mesh files, as written.
        strips: Whether folders in names of mesh files are dropped.
        merges: Whether options of attached models are taken over.
        elements: The elements that state it.
    """

    degrees: bool = True
    sequence: str = "xyz"
    autolimits: bool = True
    from_geoms: str = "auto"
    groups: tuple[float, float] = (0.0, 5.0)
    least_mass: float = 0.0
    least_inertia: float = 0.0
    balances: bool = False
    total_mass: float = -1.0
    exact_meshes: bool = False
    mesh_folder: str = ""
    strips: bool = False
    merges: bool = False
    elements: tuple[Element, ...] = ()

    @property
    def unit(self) -> float:
        """What an angle of the file is multiplied by to be in rad."""
        return float(np.pi / 180.0) if self.degrees else 1.0

    @property
    def changes_inertia(self) -> bool:
        """Whether a stated inertia may not be the one that counts."""
        bounds = self.least_mass > 0 or self.least_inertia > 0 or self.balances
        return self.from_geoms == "true" or bounds or self.total_mass > 0


@dataclass(frozen=True)
class MjcfDocument:
    """A model with its includes, and the files of what is attached to it.

    Attributes:
        path: The main file.
        name: Name of the model; that of the file where it has none.
        model: What MuJoCo calls it.
        sections: The elements of each section, in the order of the file.
        compiler: Settings of the compiler.
        gravity: Gravity, shape (3,), in m/s^2.
        texts: The bytes of each file by its path as messages call it, those of attached models too.
        attached: The models that it or one of them attaches, by path.
        naming: The elements that include a file or name it as a model to be attached, by the path of the file.
        known: Bytes of files by their path that count in place of what is in those files.
        disabled: The ``<flag>`` elements of what is switched off, by the name of the flag.
        has_fluid: Whether a fluid resists the motion.
    """

    path: object
    name: str
    model: str
    sections: Mapping[str, list[Element]]
    compiler: CompilerSettings
    gravity: Array
    texts: dict[str, bytes]
    attached: dict[str, MjcfDocument]
    naming: dict[str, list[Element]]
    known: Mapping[str, bytes]
    disabled: Mapping[str, Element] = field(default_factory=dict)
    has_fluid: bool = False

    @property
    def folder(self) -> Path:
        """Folder of the main file."""
        return Path(str(self.path)).parent

    def beside(self, element: Element, attribute: str, name: str) -> bytes:
        """Return the bytes of a file that an element names, as :func:`file_beside` does."""
        key = str(self.folder / name)
        return self.known[key] if key in self.known else file_beside(element, attribute, name, self.folder)

    def take(self, inner: MjcfDocument, element: Element) -> None:
        """Count the files of a model that an element names among those of this one."""
        self.texts.update(inner.texts)
        self.attached.update({str(inner.path): inner, **inner.attached})
        for path, elements in ((str(inner.path), [element]), *inner.naming.items()):
            known = self.naming.setdefault(path, [])
            known += [one for one in elements if all(one is not other for other in known)]

    def each(self, section: str) -> Iterator[Element]:
        """Yield the elements in all sections of one name."""
        for element in self.sections.get(section, ()):
            yield from element.children


def read_document(path: object, data: bytes, known: Mapping[str, bytes] | None = None) -> MjcfDocument:
    """Return the tree of a file with its includes in place; ``known`` has bytes of includes by their path.

    Raises:
        DescriptionError: No MJCF, an include that is missing or comes back, an unknown section, setting or unit.
    """
    root = parse_xml(path, data, _LANGUAGE)
    files = _Files(Path(str(path)).parent, known or {}, {str(path): data})
    files.include(root)
    sections: dict[str, list[Element]] = {}
    check_schema(root)
    for element in root.children:
        if element.tag not in _PASSED:
            sections.setdefault(element.tag, []).append(element)
    if "worldbody" not in sections:
        raise Place(path).error("no <worldbody> in <mujoco>", "give the MJCF of a robot")
    disabled = _disabled(sections.get("option", []))
    gravity, has_fluid = _options(sections.get("option", []))
    name = root.attributes.get("model") or PurePath(str(path)).stem
    compiler = _compiler(sections.get("compiler", []))
    return MjcfDocument(
        path,
        name if name.isprintable() else "robot",
        root.attributes.get("model", _UNNAMED),
        sections,
        compiler,
        np.zeros(3) if "gravity" in disabled else gravity,
        files.texts,
        {},
        {path: [element] for path, element in files.includes.items()},
        files.known,
        disabled,
        has_fluid,
    )


def included_files(path: object, data: bytes) -> tuple[str, ...]:
    """Return the files that an MJCF includes, and those of the models that may be attached to it with their includes.

    A model that cannot be read is left out: it is attached nowhere, since the reader would have refused it.

    Raises:
        DescriptionError: As of :func:`read_document`.
    """
    document = read_document(path, data)
    found, waiting = dict.fromkeys(document.texts), [document]
    while waiting:
        document = waiting.pop()
        for element in document.each("asset"):
            file = element.attributes.get("file", "") if element.tag == "model" else ""
            inner = str(document.folder / file)
            if file and inner not in found:
                with suppress(DescriptionError):
                    waiting.append(read_document(inner, file_beside(element, "file", file, document.folder)))
                    found |= dict.fromkeys(waiting[-1].texts)
    return tuple(one for one in found if one != str(path))


@dataclass(frozen=True)
class _Files:
    """The files of a model: the main one and its includes.

    Attributes:
        folder: Folder of the main file.
        known: Bytes of includes by their path that count in place of what is in those files.
        texts: The bytes of each file that was read, by its path.
        includes: The elements that include files, by the path of what they include.
    """

    folder: Path
    known: Mapping[str, bytes]
    texts: dict[str, bytes]
    includes: dict[str, Element] = field(default_factory=dict)

    def include(self, root: Element) -> None:
        """Put what files include in place of their ``<include>``, in the whole tree below an element."""
        for place in range(len(root.children) - 1, -1, -1):
            child = root.children[place]
            if child.tag != "include":
                self.include(child)
        for place in range(len(root.children) - 1, -1, -1):
            child = root.children[place]
            if child.tag == "include":
                inner = self._included(child)
                self.include(inner)
                root.children[place : place + 1] = inner.children

    def _included(self, element: Element) -> Element:
        """Return the tree of an include: relative to the folder of the main file, else to that of the including one."""
        name = Values(element.place, element.attributes).name("file")
        near = Path(str(element.path)).parent
        folders = [one for one in (self.folder, near) if str(one / name) in self.known or os.path.isfile(one / name)]
        folder = folders[0] if folders else self.folder
        key = str(folder / name)
        data = self.known[key] if key in self.known else file_beside(element, "file", name, folder)
        if key in self.texts or len(self.texts) >= MAX_FILES:
            evidence = f"the file {shown(name)} is included twice"
            raise element.place.error(evidence, "include each file once: remove one of the two")
        self.texts[key] = data
        self.includes[key] = element
        return parse_xml(key, data, _INCLUDED)


def file_beside(element: Element, attribute: str, name: str, folder: Path) -> bytes:
    """Return the bytes of a file that an element names, relative to the folder of the main file.

    Raises:
        DescriptionError: An absolute name, no such file, or one that cannot be read or is too large.
    """
    file = folder / name
    if PurePath(name).is_absolute() or ".." in PurePath(os.path.normpath(name)).parts[1:] or "\0" in name:
        evidence = f"{attribute} {shown(name)} leads elsewhere"
        raise element.place.error(evidence, "write a name relative to the folder of the main file")
    if not os.path.isfile(file):
        where = "the current folder" if str(folder) == "." else folder
        evidence = f"the file {shown(name)} is missing in {where}"
        raise element.place.error(evidence, f"put it there, or correct the name or remove the <{element.tag}>")
    try:
        with file.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except OSError as problem:
        evidence = f"the file {shown(name)} cannot be read ({problem.strerror})"
        raise element.place.error(evidence, "check its permissions") from problem
    if len(data) > MAX_BYTES:
        raise element.place.error(f"the file {shown(name)} is larger than 20 MB", "give the model of one robot")
    return data


def _options(elements: list[Element]) -> tuple[Array, bool]:
    """Return gravity, and whether there is a fluid."""
    gravity, fluid = np.array([0.0, 0.0, -9.81]), False
    for element in elements:
        values = Values(element.place, element.attributes)
        gravity = values.numbers("gravity", 3) if "gravity" in values else gravity
        fluid |= any(name in values and values.number(name) > 0 for name in ("density", "viscosity"))
    return gravity, fluid


def _disabled(elements: list[Element]) -> dict[str, Element]:
    """Return the flags that are switched off; of several the last one counts.

    What ``constraint`` and ``passive`` (before MuJoCo 3.3) switch off counts as switched off by its own flag.
    """
    found: dict[str, Element] = {}
    for flag in (flag for element in elements for flag in element.all("flag")):
        values = Values(flag.place, flag.attributes)
        for name in flag.attributes:
            found.pop(name, None)
            if values.choice(name, ("enable", "disable"), "enable") == "disable":
                found[name] = flag
    for whole, parts in (("constraint", ("equality", "frictionloss")), ("passive", ("spring", "damper"))):
        found |= {part: found[whole] for part in parts if whole in found}
    return found


def _compiler(elements: list[Element]) -> CompilerSettings:
    if not elements:
        return CompilerSettings()
    given: dict[str, str] = {}
    for element in elements:
        given.update(Values(element.place, element.attributes).given)
    values = Values(elements[-1].place, given)
    if values.text("coordinate", "local") != "local":
        step = 'save it with MuJoCo 2.3.3 or earlier, which writes local coordinates, or write coordinate="local"'
        raise values.place.error(f"coordinate {shown(values.text('coordinate'))} is no longer read", step)
    sequence = values.text("eulerseq", "xyz")
    if len(sequence) != 3 or any(letter not in "xyzXYZ" for letter in sequence):
        raise values.place.error(f"eulerseq {shown(sequence)} is no order of axes", "write three of x y z X Y Z")
    groups = values.numbers("inertiagrouprange", 2) if "inertiagrouprange" in values else (0.0, 5.0)
    exact = values.flag("exactmeshinertia", False)
    return CompilerSettings(
        degrees=values.choice("angle", ("degree", "radian"), "degree") == "degree",
        sequence=sequence,
        autolimits=values.flag("autolimits", True),
        from_geoms=values.choice("inertiafromgeom", ("false", "true", "auto"), "auto"),
        groups=(float(groups[0]), float(groups[1])),
        least_mass=values.at_least_zero("boundmass", 0.0),
        least_inertia=values.at_least_zero("boundinertia", 0.0),
        balances=values.flag("balanceinertia", False),
        total_mass=values.number("settotalmass", -1.0),
        exact_meshes=exact,
        mesh_folder=values.text("meshdir", values.text("assetdir", "")),
        strips=values.flag("strippath", False),
        merges=values.choice("conflict", ("warning", "merge", "error"), "warning") == "merge",
        elements=tuple(elements),
    )
