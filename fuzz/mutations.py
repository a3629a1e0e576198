"""Changes of files: of their bytes, their words, their values and the members of their archives."""

from __future__ import annotations

import copy
import io
import json
import random
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

_MOST = 1 << 20
_NUMBERS = (
    "0", "-0", "-1", "1e999", "-1e308", "5e-324", "nan", "inf", "-inf", "9" * 40, "1e", "0x7f", "", " ", "\x00", "½",
    "true", "null", "[]", "{}", "2147483648", "18446744073709551616", "\ud7ff", "\U0001f916", "../../etc/hostname",
)  # fmt: skip
_VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**31, 2**63, 10**30, 1e308, -1e308, 5e-324, float("nan"), float("inf"), "",
    "x", "nan",
    "../../etc/hostname", "\x00", [], {}, [[]], [None], {"": 0}, [0] * 1000, "x" * 5000,
)  # fmt: skip
_TOKEN = re.compile(rb"[A-Za-z_]+|[-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?|[^\sA-Za-z0-9]")
_COUNTS = (
    0,
    1,
    0x7F,
    0x80,
    0xFF,
    0x7FFF,
    0xFFFF,
    0x7FFFFFFF,
    0x80000000,
    0xFFFFFFFF,
    1 << 40,
    (1 << 63) - 1,
    (1 << 64) - 1,
)


def mutated(kind: str, data: bytes, other: bytes, draw: random.Random, words: Sequence[str] = ()) -> bytes:
    """Return a changed file: one to four changes, of its own kind mostly, of plain bytes else."""
    ways = _WAYS[kind]
    for _ in range(draw.choice((1, 1, 1, 2, 2, 3, 4))):
        data = draw.choice(ways)(data, other, draw, words)
    return data[:_MOST]


def _bytes(data: bytes, other: bytes, draw: random.Random, words: Sequence[str]) -> bytes:
    if not data:
        return other[:64]
    place = draw.randrange(len(data))
    size = min(draw.choice((1, 1, 2, 4, 8, 16, 64, 512)), len(data) - place)
    before, piece, after = data[:place], data[place : place + size], data[place + size :]
    match draw.randrange(8):
        case 0:
            new = bytes([piece[0] ^ (1 << draw.randrange(8))]) + piece[1:]
        case 1:  # a count of 1, 2, 4 or 8 bytes
            form = draw.choice("BHIQ")
            count = draw.choice(_COUNTS) & ((1 << 8 * struct.calcsize(form)) - 1)
            packed = struct.pack(draw.choice("<>") + form, count)
            new, after = packed, data[place + len(packed) :]
        case 2:
            new = b""
        case 3:
            new = piece * draw.choice((2, 3, 50))
        case 4:
            new = draw.randbytes(size)
        case 5:
            new, after = b"", b""
        case 6:  # a piece of another file
            start = draw.randrange(len(other)) if other else 0
            new = other[start : start + size]
        case _:
            new = draw.randbytes(size) + piece
    return before + new + after


def _words(data: bytes, other: bytes, draw: random.Random, words: Sequence[str]) -> bytes:
    one = _token(data, draw)
    if one is None:
        return _bytes(data, other, draw, words)
    if draw.random() < 0.4:
        new = draw.choice((*_NUMBERS, *words)).encode("utf-8", "surrogatepass")
    else:
        new = (_token(data, draw) or one).group()
    return data[: one.start()] + new + data[one.end() :]


def _token(data: bytes, draw: random.Random) -> re.Match[bytes] | None:
    """Return the word, number or sign at a random place, or the first."""
    start = draw.randrange(len(data) or 1)
    while start and (data[start - 1 : start].isalnum() or data[start - 1 : start] in (b".", b"_")):
        start -= 1
    return _TOKEN.search(data, start) or _TOKEN.search(data)


def _lines(data: bytes, other: bytes, draw: random.Random, words: Sequence[str]) -> bytes:
    lines = data.split(b"\n")
    k = draw.randrange(len(lines))
    way = draw.randrange(5)
    if way == 0:
        del lines[k]
    elif way == 1:
        lines.insert(k, draw.choice(lines))
    elif way == 2:
        lines.insert(k, draw.choice(other.split(b"\n")))
    elif way == 3:
        lines[k] = b" " * draw.choice((1, 2, 200)) + lines[k]
    else:
        lines.insert(k, draw.choice((*_NUMBERS, *words)).encode("utf-8", "surrogatepass"))
    return b"\n".join(lines)


def _json(data: bytes, other: bytes, draw: random.Random, words: Sequence[str]) -> bytes:
    try:
        value = _parsed.pop(data) if data in _parsed else json.loads(data)
    except (ValueError, RecursionError):
        return _bytes(data, other, draw, words)
    _parsed.clear()
    holders = _holders(value)
    if not holders:
        return json.dumps(draw.choice(_VALUES)).encode()
    holder = draw.choice(holders)
    key = _key(holder, draw)
    way = draw.randrange(6)
    if way == 0:
        del holder[key]
    elif way == 1:
        some = draw.choice(holders)
        holder[key] = json.loads(json.dumps(some[_key(some, draw)]))
    elif way == 2 and isinstance(holder, list):
        holder.insert(key, holder[key])
    elif way == 3:
        for _ in range(draw.choice((1, 50, 900))):
            holder[key] = [holder[key]]
    elif way == 4 and isinstance(holder[key], int | float) and not isinstance(holder[key], bool):
        holder[key] *= draw.choice((-1, 1e-300, 1e300, 1 + 1e-9, 0.5))
    else:
        holder[key] = copy.copy(draw.choice(_VALUES))
    try:
        written = json.dumps(value).encode()
    except (ValueError, RecursionError):
        return _bytes(data, other, draw, words)
    _parsed[written] = value
    return written


#: The value of the last file, which the next change is of more often than not.
_parsed: dict[bytes, Any] = {}


def _holders(value: Any) -> list[Any]:
    """Return the mappings and lists in a value that are not empty."""
    found, stack = [], [value]
    while stack:
        one = stack.pop()
        items = one.values() if isinstance(one, dict) else one if isinstance(one, list) else ()
        if items:
            found.append(one)
            stack += [item for item in items if isinstance(item, dict | list)]
    return found


def _key(holder: Any, draw: random.Random) -> Any:
    return draw.choice(list(holder)) if isinstance(holder, dict) else draw.randrange(len(holder))


def _zip(data: bytes, other: bytes, draw: random.Random, words: Sequence[str]) -> bytes:
    """Change a member and pack the archive again, so that its sums are right."""
    try:
        members = dict(_unpacked.get(data) or _members(data))
    except Exception:  # any damage of an earlier change
        return _bytes(data, other, draw, words)
    if not members:
        return _bytes(data, other, draw, words)
    name = draw.choice(list(members))
    way = draw.randrange(5)
    if way == 0:
        del members[name]
    elif way == 1:
        members[name] = members[draw.choice(list(members))]
    elif way == 2 and b"{" in members[name][:300]:  # the dictionary of the header, or JSON in an array
        members[name] = _words(members[name], other, draw, words)
    elif way == 3:
        members[draw.choice((f"../{name}", "q.npy", "t.npy", "x.npy"))] = members.pop(name)
    else:
        members[name] = _bytes(members[name], members[name], draw, words)
    packed = _packed(members, deflate=draw.randrange(8) == 0)
    _unpacked[packed] = members
    if len(_unpacked) > 100:
        _unpacked.pop(next(iter(_unpacked)))
    return packed


#: Members of the last archives: most changes are of one that was changed or read just before.
_unpacked: dict[bytes, Mapping[str, bytes]] = {}


def _members(data: bytes) -> Mapping[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {one.filename: archive.read(one) for one in archive.infolist() if one.file_size < _MOST}
    _unpacked[data] = members
    return members


def _packed(members: Mapping[str, bytes], deflate: bool) -> bytes:
    """Return an archive; the package zipfile takes as long for it as a reader for reading it."""
    content, directory = bytearray(), bytearray()
    for name, member in members.items():
        label = name.encode("utf-8", "surrogateescape")
        packed = zlib.compress(member, wbits=-15) if deflate else member
        facts = (20, 0x800, 8 if deflate else 0, 0, 0x21, zlib.crc32(member), len(packed), len(member), len(label), 0)
        directory += struct.pack("<4s6H3L5H2L", b"PK\1\2", 20, *facts, 0, 0, 0, 0, len(content)) + label
        content += struct.pack("<4s5H3L2H", b"PK\3\4", *facts) + label + packed
    count = len(members)
    end = struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, count, count, len(directory), len(content), 0)
    return bytes(content + directory + end)


_Way = Callable[[bytes, bytes, random.Random, Sequence[str]], bytes]
_WAYS: dict[str, tuple[_Way, ...]] = {
    "text": (_words, _words, _words, _lines, _lines, _bytes),
    "json": (_json, _json, _json, _json, _words, _bytes),
    "zip": (_zip, _zip, _zip, _bytes),
    "bytes": (_bytes,),
}
