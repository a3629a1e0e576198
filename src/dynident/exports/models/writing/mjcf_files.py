"""The files of an MJCF with edits in them: which of them change, and the names and folders of their copies."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr, unescape

from dynident.exports.models.writing.xml_edit import (
    ByteEdit,
    PlacedElement,
    added_child,
    apply,
    elements,
    preorder,
    unused_name,
    with_attributes,
)
from dynident.robot_files.mjcf.document import MjcfDocument
from dynident.robot_files.xml_elements import Element

_NAMED = re.compile(r"""<(?:include|model)\s[^>]*?\bfile\s*=\s*["']([^"'/]+)["']""")


class MjcfFiles:
    """Collects the edits of each file of a model."""

    def __init__(self, document: MjcfDocument) -> None:
        self._document = document
        self._models = {str(document.path): document, **document.attached}
        self._placed: dict[str, list[PlacedElement]] = {}
        self._edits: dict[str, list[ByteEdit]] = {}
        self._names: dict[str, str] = {}

    def of(self, element: Element) -> tuple[bytes, PlacedElement]:
        """Return the file of an element, and where it stands in it."""
        key = str(element.path)
        data = self._document.texts[key]
        if key not in self._placed:
            self._placed[key] = list(preorder(elements(element.path, data)))
        return data, self._placed[key][element.number]

    def add(self, element: Element, edit: ByteEdit) -> None:
        """Add an edit of the file of an element, once."""
        edits = self._edits.setdefault(str(element.path), [])
        if edit not in edits:
            edits.append(edit)

    def set(self, element: Element, values: dict[str, str]) -> None:
        """Set attributes of an element."""
        data, place = self.of(element)
        self.add(element, with_attributes(data, place, values))

    def append(self, text: bytes) -> None:
        """Add an element at the end of the main file."""
        path = str(self._document.path)
        data = self._document.texts[path]
        self._edits.setdefault(path, []).append(added_child(data, elements(path, data), text))

    def texts(self, output: Path, is_elsewhere: bool) -> tuple[dict[str, bytes], list[str]]:
        """Return the files that changed, by path, and the names of those beside the main one.

        A changed include or attached model has a new name, which the files that name it have; it is beside the main
        file. Of an output in another folder all of them are among the files.

        No name is that of a file of the model, or of one beside the output that an earlier output does not name.
        """
        document = self._document
        changed = {str(document.path), *(document.naming if is_elsewhere else ())}
        waiting = list(self._edits)
        while waiting:
            path = waiting.pop()
            if path not in changed:
                changed.add(path)
                waiting += [str(element.path) for element in document.naming[path]]
        taken = {Path(path).stem for path in document.texts} | _beside_not_of(output)
        for path in (path for path in document.naming if path in changed):
            stem = unused_name(f"{output.stem}-{Path(path).stem}", taken)
            taken.add(stem)
            self._names[path] = stem + Path(path).suffix
        for path, elements_of in document.naming.items():
            name = self._names.get(path, Path(os.path.relpath(path, document.folder)).as_posix())
            for element in elements_of:
                if str(element.path) in changed and Path(name) != Path(element.attributes["file"]):
                    self.set(element, {"file": name})
        for path in (path for path in self._models if path in changed):
            self._point_at_others(self._models[path], output)
        return {
            self._new(path): apply(document.texts[path], self._edits.get(path, []))
            for path in document.texts
            if path in changed
        }, list(self._names.values())

    def _point_at_others(self, model: MjcfDocument, output: Path) -> None:
        """Name the models that a changed one does not attach, which MuJoCo reads too, from the folder of an output."""
        attached = [element for elements_of in self._document.naming.values() for element in elements_of]
        for element in model.each("asset"):
            if element.tag == "model" and all(element is not one for one in attached):
                file = Path(element.attributes.get("file", ""))
                name = Path(_from(output, model.folder / file.parent), file.name)
                if name != file:
                    self.set(element, {"file": name.as_posix()})

    def found_from(self, file: Path, texts: Mapping[str, bytes]) -> tuple[dict[str, bytes], list[str]]:
        """Return changed files with settings of the compiler by which meshes and textures are found, and these folders.

        Args:
            file: The main file, beside which the others are written.
            texts: The changed files.
        """
        found, named = dict(texts), list[str]()
        for path, model in self._models.items():
            new = self._new(path)
            if new in found and model.folder.resolve() != file.resolve().parent:
                folders = _asset_folders(model, file)
                named += [name for name in folders.values() if name not in named]
                found[new] = _with_folders(new, found[new], folders) if folders else found[new]
        return found, named

    def _new(self, path: str) -> str:
        """Return where the copy of a file is, beside the main one."""
        return str(self._document.folder / self._names[path]) if path in self._names else path


def _asset_folders(model: MjcfDocument, output: Path) -> dict[str, str]:
    """Return the folders of meshes and textures of a model, as settings of the compiler, from that of an output."""
    given = dict[str, str]()
    for element in model.compiler.elements:
        given.update(element.attributes)
    named = {
        one.tag for section in ("asset", "deformable") for one in model.each(section) if one.attributes.get("file")
    }
    found: dict[str, str] = {}
    for key, tags in (("meshdir", {"mesh", "hfield", "skin"}), ("texturedir", {"texture"})):
        own = Path(given.get(key, given.get("assetdir", "")))
        if named & tags and not own.is_absolute():
            found[key] = _from(output, model.folder / own)
    return found


def _from(output: Path, place: Path) -> str:
    """Return the name of a place as seen from the folder of an output."""
    try:
        return Path(os.path.relpath(place.resolve(), output.resolve().parent)).as_posix()
    except ValueError:  # on another drive
        return place.resolve().as_posix()


def _with_folders(path: str, data: bytes, folders: Mapping[str, str]) -> bytes:
    """Return a model with settings of the compiler that count more than all others in it."""
    text = " ".join(f"{key}={quoteattr(name)}" for key, name in folders.items())
    return apply(data, [added_child(data, elements(path, data), f"<compiler {text}/>".encode())])


def _beside_not_of(output: Path) -> set[str]:
    """Return the names, without endings, of files beside an output that it does not name as it is now."""
    folder = output.absolute().parent
    own, waiting = set[str](), [output.name]
    while waiting:
        name = waiting.pop()
        if name not in own and (folder / name).is_file():
            own.add(name)
            words = _NAMED.findall((folder / name).read_text("utf-8", errors="replace"))
            waiting += [unescape(word, {"&quot;": '"', "&apos;": "'"}) for word in words]
    return {file.stem for file in folder.iterdir() if file.name not in own} if folder.is_dir() else set()
