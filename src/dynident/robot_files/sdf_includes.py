"""An SDF with the models that it includes in place: ``<include>`` by a path, or by ``model://NAME``.

Source: SDFormat 1.12, ``<include>``. A folder is a model where its ``model.config`` names the SDF of it. What an
``<include>`` states (name, pose, placement frame, static) counts in place of what the included model states.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from dynident.errors import FileError
from dynident.files import read_at_most
from dynident.model.documents.numbers import shown
from dynident.robot_files.ros_packages import package_folder
from dynident.robot_files.sdf_elements import check_words, only_child, version_of
from dynident.robot_files.xml_elements import Element, XmlLanguage, parse_xml

_SDF: Final = XmlLanguage("SDF", ("sdf",), "link")
_CONFIG: Final = XmlLanguage("model.config of a model", ("model",), "link")
_MAX_BYTES: Final = 20_000_000
_MAX_INCLUDES: Final = 200
#: Folders above a file in which the models that it names by ``model://`` are looked for.
_LEVELS_UP: Final = 3
#: Where Gazebo and Drake look for them, folders that hold models.
_VARIABLES: Final = ("GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH", "GAZEBO_MODEL_PATH")
_SCHEMES: Final = ("model://", "package://")


@dataclass(frozen=True)
class SdfFiles:
    """The files of a model.

    Attributes:
        texts: Bytes of each by its path as messages call it, the main one first.
        versions: The version of SDF that each states.
        includes: The includes that were read, a file as often as it is included.
    """

    texts: dict[str, bytes] = field(default_factory=dict)
    versions: dict[str, tuple[int, int]] = field(default_factory=dict)
    includes: list[Element] = field(default_factory=list)


def read_sdf_files(path: object, data: bytes) -> tuple[Element, SdfFiles]:
    """Return the root of an SDF whose includes are replaced by the models that they include, and all its files.

    Raises:
        DescriptionError: No SDF, an unknown word, or an include that is missing, comes back or is merged.
    """
    files = SdfFiles()
    root = _parsed(path, data, files)
    for holder in (root, *root.all("world")):
        _include(holder, files, (str(path),))
    return root, files


def _parsed(path: object, data: bytes, files: SdfFiles) -> Element:
    root = parse_xml(path, data, _SDF)
    check_words(root)
    files.texts[str(path)] = data
    files.versions[str(path)] = version_of(root)
    return root


def _include(holder: Element, files: SdfFiles, above: tuple[str, ...]) -> None:
    """Replace the includes in an element and in the models of it; ``above`` are the files that lead there."""
    for place, child in enumerate(holder.children):
        if child.tag == "include":
            holder.children[place] = _included(child, files, above)
        elif child.tag == "model":
            _include(child, files, above)


def _included(element: Element, files: SdfFiles, above: tuple[str, ...]) -> Element:
    """Return the model that an ``<include>`` stands for; of a light or actor an element that is passed over."""
    if element.attributes.get("merge", "false") in ("true", "1"):
        step = 'expand it first (gz sdf -p FILE > model.sdf), or remove merge="true" and write NAME:: before its names'
        raise element.place.error("a merged include is not read", step)
    uri = only_child(element, "uri", "write one <uri>").text
    file = _file_of(element, uri)
    files.includes.append(element)
    if str(file) in above:
        raise element.place.error(f"{shown(uri)} includes itself", "remove this include")
    if len(files.includes) > _MAX_INCLUDES:
        raise element.place.error(f"more than {_MAX_INCLUDES} includes", "give the SDF of one robot")
    try:
        data = read_at_most(file, _MAX_BYTES, "give the model of one robot")
    except FileError as problem:
        raise element.place.error(f"{file}: {problem.evidence}", problem.step) from problem
    root = _parsed(file, data, files)
    models = root.all("model")
    if not models and (root.all("light") or root.all("actor")):
        return replace(element, tag="light", children=[])
    if len(models) != 1:
        raise element.place.error(f"{len(models)} <model> in {file}", "include a file with one <model>")
    _include(root, files, (*above, str(file)))
    return _with_stated(root.all("model")[0], element)


def _with_stated(model: Element, include: Element) -> Element:
    """Return a model with what its include states in place of what it states itself."""
    stated = {tag: include.all(tag)[0] for tag in ("name", "placement_frame") if include.all(tag)}
    attributes = {**model.attributes, **{tag: one.text for tag, one in stated.items()}}
    own = [include.all(tag)[0] for tag in ("pose", "static") if include.all(tag)]
    tags = {one.tag for one in own}
    return replace(model, attributes=attributes, children=[*own, *(c for c in model.children if c.tag not in tags)])


def _file_of(element: Element, uri: str) -> Path:
    """Return the file of the model that a ``<uri>`` names."""
    for place in _places(element, uri):
        if os.path.isfile(place):  # a name too long for the system is none, where Path.is_file raises
            return place
        if os.path.isfile(place / "model.config"):
            return _named_by_config(element, place)
    if "://" in uri and not uri.startswith(_SCHEMES):
        raise element.place.error(f"the uri {shown(uri)} is not on this machine", "download it, and write its path")
    where = f" in {', '.join(_VARIABLES[:3])}," if uri.startswith(_SCHEMES) else ""
    evidence = f"{shown(uri)} is missing{where} beside {element.path} and in the folders above it"
    raise element.place.error(evidence, "put it there, or correct the <uri> or remove the <include>")


def _places(element: Element, uri: str) -> Iterator[Path]:
    folder = Path(str(element.path)).parent
    scheme = next((scheme for scheme in _SCHEMES if uri.startswith(scheme)), "")
    name = uri.removeprefix(scheme)
    if not name or "\0" in name or Path(name).is_absolute() or "://" in name:
        return
    ups = Path(name).parts.count("..")
    if not scheme and ups <= _LEVELS_UP:
        yield folder / name
    if not scheme or ups:
        return
    package, _, rest = name.partition("/")
    if scheme == "package://" and (found := package_folder(package, str(element.path))) is not None:
        yield found / rest
    above = Path(os.path.abspath(folder))
    holders = (above, *above.parents[:_LEVELS_UP])
    yield from (holder / name for holder in holders)
    yield from (holder / rest for holder in holders if holder.name == package and rest)
    for variable in _VARIABLES:
        yield from (Path(entry) / name for entry in os.environ.get(variable, "").split(os.pathsep) if entry)


def _named_by_config(element: Element, folder: Path) -> Path:
    """Return the SDF that a ``model.config`` names, the one of the latest version."""
    config = folder / "model.config"
    root = parse_xml(config, read_at_most(config, _MAX_BYTES, "give the model of one robot"), _CONFIG)
    named = {version_of(one): one.text for one in root.all("sdf") if one.text}
    name = named[max(named)] if named else ""
    if Path(name).name != name or "\0" in name or not os.path.isfile(folder / name):
        raise element.place.error(f"{config} names no SDF beside it", "write <sdf version=...>model.sdf</sdf> in it")
    return folder / name
