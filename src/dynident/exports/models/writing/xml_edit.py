"""Changes in an XML file that leave every other byte as it is, and what the XML formats share.

Where elements stand and how they are replaced; numbers to the last bit, orientations exact to rounding, names that XML
can hold.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final
from xml.parsers import expat
from xml.sax.saxutils import escape

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption, DescriptionError
from dynident.model.shapes import Capsule

_TAG: Final = re.compile(rb"<[^\s/>]+((?:\s+[^\s=]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*)\s*(/?)>")
_ATTRIBUTE: Final = re.compile(rb"(\s+)([^\s=]+)(\s*=\s*)(\"[^\"]*\"|'[^']*')")

_WIDE: Final = (b"\xff\xfe", b"\xfe\xff", b"\x00<", b"<\x00")


@dataclass(frozen=True)
class PlacedElement:
    """An element and where it stands in the bytes.

    Attributes:
        tag: Its name.
        attributes: Its attributes.
        start: Place of its first byte.
        inside: Place behind its start tag.
        close: Place of its end tag; that of ``inside`` where it has none.
        end: Place behind it.
        children: The elements in it.
    """

    tag: str
    attributes: dict[str, str]
    start: int
    inside: int
    close: int
    end: int
    children: tuple[PlacedElement, ...] = ()

    @property
    def is_empty(self) -> bool:
        """Whether it is written as one tag that closes itself."""
        return self.close == self.end

    def all(self, tag: str) -> list[PlacedElement]:
        """Return the children of one name."""
        return [child for child in self.children if child.tag == tag]


@dataclass
class _Open:
    tag: str
    attributes: dict[str, str]
    start: int
    children: list[PlacedElement] = field(default_factory=list)


def elements(path: object, data: bytes) -> PlacedElement:
    """Return the root element of an XML file that has passed the strict reader.

    Raises:
        DescriptionError: Characters of two bytes: places in them are not those of plain text.
    """
    if data.startswith(_WIDE):
        raise DescriptionError(path, "", "it is written in UTF-16", "save it as UTF-8")
    stack: list[_Open] = [_Open("", {}, 0)]
    parser: Any = expat.ParserCreate()

    def begin(tag: str, attributes: dict[str, str]) -> None:
        stack.append(_Open(tag, attributes, parser.CurrentByteIndex))

    def finish(_: str) -> None:
        opened, index = stack.pop(), parser.CurrentByteIndex
        match = _TAG.match(data, opened.start)
        assert match is not None  # it is well-formed: expat has read it
        inside = match.end()
        close = end = inside
        if not match.group(2):
            close, end = index, data.index(b">", index) + 1
        found = PlacedElement(opened.tag, opened.attributes, opened.start, inside, close, end, tuple(opened.children))
        stack[-1].children.append(found)

    parser.StartElementHandler, parser.EndElementHandler = begin, finish
    parser.Parse(data, True)
    return stack[0].children[0]


def preorder(element: PlacedElement) -> Iterator[PlacedElement]:
    """Yield an element and all in it, in the order in which they begin in the file."""
    yield element
    for child in element.children:
        yield from preorder(child)


@dataclass(frozen=True)
class ByteEdit:
    """Bytes in place of those from ``start`` to ``end``."""

    start: int
    end: int
    text: bytes


def apply(data: bytes, edits: Sequence[ByteEdit]) -> bytes:
    """Return the bytes with all edits made; edits that stand at one place keep their order."""
    parts: list[bytes] = []
    place = 0
    for edit in sorted(edits, key=lambda e: (e.start, e.end)):
        assert edit.start >= place  # no two edits touch the same bytes
        parts += [data[place : edit.start], edit.text]
        place = edit.end
    return b"".join([*parts, data[place:]])


def with_attributes(data: bytes, element: PlacedElement, values: dict[str, str]) -> ByteEdit:
    """Return the edit that sets attributes in a start tag; those that are missing follow the others."""
    match = _TAG.match(data, element.start)
    assert match is not None
    start, tag = match.start(1), match.group(1)
    left = dict(values)

    def put(found: re.Match[bytes]) -> bytes:
        name = found.group(2).decode("utf-8", "replace")
        if name not in left:
            return found.group(0)
        mark = found.group(4)[:1]
        return found.group(1) + found.group(2) + found.group(3) + mark + _attribute(left.pop(name)) + mark

    text = _ATTRIBUTE.sub(put, tag)
    text += b"".join(b' %s="%s"' % (name.encode("ascii"), _attribute(value)) for name, value in left.items())
    return ByteEdit(start, match.end(1), text)


def _attribute(value: str) -> bytes:
    """Return a value as it is written between quotes, in any encoding that has ASCII."""
    return escape(value, {'"': "&quot;", "'": "&apos;"}).encode("ascii", "xmlcharrefreplace")


def without_attributes(data: bytes, element: PlacedElement, gone: Collection[str], values: dict[str, str]) -> ByteEdit:
    """Return the edit that takes attributes out of a start tag and sets others as :func:`with_attributes` does."""
    edit = with_attributes(data, element, values)

    def put(found: re.Match[bytes]) -> bytes:
        return b"" if found.group(2).decode("utf-8", "replace") in gone else found.group(0)

    return ByteEdit(edit.start, edit.end, _ATTRIBUTE.sub(put, edit.text))


def indent_of(data: bytes, place: int) -> bytes:
    """Return the line end and blanks before ``place``; empty where something else stands on its line."""
    head = data.rfind(b"\n", 0, place)
    blank = data[head + 1 : place]
    if head < 0 or blank.strip(b" \t"):
        return b""
    return (b"\r\n" if data[:head].endswith(b"\r") else b"\n") + blank


def added_child(data: bytes, parent: PlacedElement, text: bytes) -> ByteEdit:
    """Return the edit that puts an element behind the last one in ``parent``, on a line of its own where those are."""
    if parent.children:
        last = parent.children[-1]
        return ByteEdit(last.end, last.end, indent_of(data, last.start) + text)
    outer = indent_of(data, parent.start)
    step = b"  " if outer else b""
    if not parent.is_empty:
        return ByteEdit(parent.inside, parent.inside, outer + step + text if outer else text)
    name = parent.tag.encode("utf-8")
    slash = data.rindex(b"/", parent.start, parent.inside)
    return ByteEdit(slash, parent.inside, b">" + outer + step + text + outer + b"</" + name + b">")


def removed(data: bytes, element: PlacedElement) -> ByteEdit:
    """Return the edit that takes an element out, with the blanks before it."""
    return ByteEdit(element.start - len(indent_of(data, element.start)), element.end, b"")


def without_elements(data: bytes, tags: Collection[str]) -> bytes:
    """Return the file without the elements of some names, wherever they stand."""

    def found(element: PlacedElement) -> Iterator[ByteEdit]:
        for child in element.children:
            if child.tag in tags:
                yield ByteEdit(child.start, child.end, b"")
            else:
                yield from found(child)

    return apply(data, list(found(elements("", data))))


def number(value: float) -> str:
    """Return a number so that reading it gives the same bits; zero has no sign."""
    return repr(float(value) + 0.0)


def numbers(values: Iterable[float] | Array) -> str:
    """Return numbers with blanks between."""
    return " ".join(number(value) for value in values)


def quaternion(rotation: Array) -> Array:
    """Return (w, x, y, z) with w >= 0 of a rotation matrix, shape (3, 3) -> (4,) (Shepperd 1978: no small divisor)."""
    r = np.asarray(rotation, dtype=float)
    trace = float(np.trace(r))
    squares = np.array([1.0 + trace, *(1.0 + 2.0 * np.diag(r) - trace)])  # 4 w^2, 4 x^2, 4 y^2, 4 z^2
    k = int(np.argmax(squares))
    odd = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    if k == 0:
        found = np.array([squares[0], *odd])
    else:
        a = k - 1
        found = np.array([odd[a], *(r[a] + r[:, a])])
        found[k] = squares[k]
    found = found / np.linalg.norm(found)
    return (found if found[0] >= 0 else -found) + 0.0


def roll_pitch_yaw(rotation: Array) -> Array:
    """Return (roll, pitch, yaw) in rad with R = Rz(yaw) Ry(pitch) Rx(roll), shape (3, 3) -> (3,).

    Where pitch is a right angle only roll and yaw together are determined: yaw is then what rounding makes it, and roll
    is computed for that yaw.
    """
    r = np.asarray(rotation, dtype=float)
    yaw = np.arctan2(r[1, 0], r[0, 0])
    cos, sin = np.cos(yaw), np.sin(yaw)
    rest = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ r  # Ry(pitch) Rx(roll)
    return np.array([np.arctan2(-rest[1, 2], rest[1, 1]), np.arctan2(-rest[2, 0], rest[0, 0]), yaw]) + 0.0


def checked_names(what: str, names: Sequence[str]) -> list[str]:
    """Return names that can stand in XML, each once.

    Raises:
        BadOption: An empty name, characters that cannot be printed, or two alike.
    """
    check_printable(what, names)
    for name in names:
        if names.count(name) > 1:
            raise BadOption(what, name, f"two have this name; give each {what} a name of its own")
    return list(names)


def check_printable(what: str, names: Sequence[str]) -> None:
    """Refuse names that no reader of a robot model takes.

    Raises:
        BadOption: An empty name, or characters that cannot be printed.
    """
    for name in names:
        if not name.strip() or not name.isprintable():
            raise BadOption(what, name, "rename it in the robot model: it must be plain text of one line")


def unused_name(name: str, taken: Collection[str]) -> str:
    """Return the name, with a number behind it where it is taken."""
    found, number = name, 2
    while found in taken:
        found, number = f"{name}_{number}", number + 1
    return found


def along(capsule: Capsule) -> Array:
    """Return a rotation whose z axis is that of a capsule, shape (3, 3)."""
    z = (capsule.end - capsule.start) / capsule.length
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
