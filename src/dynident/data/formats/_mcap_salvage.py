"""MCAP files that were cut while they were written: the messages before the cut.

The records are read from the front, without the index at the end that a cut file lacks, as the MCAP specification
(Foxglove, version 0) lays them out.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

MAGIC = b"\x89MCAP0\r\n"

#: Bytes of one chunk, unpacked, at most.
_MAX_CHUNK = 1 << 30

_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0F


@dataclass(frozen=True)
class McapChannel:
    """What a channel of the file carries.

    Attributes:
        topic: Name of the topic.
        msgtype: Type of its messages, such as ``sensor_msgs/msg/JointState``.
        encoding: Language of the definition, ``ros2msg`` or ``ros2idl``.
        definition: Definition of the type.
    """

    topic: str
    msgtype: str
    encoding: str
    definition: str


class Unsound(Exception):
    """A record that ends before it should, or holds what it cannot."""


def is_cut(path: Path) -> bool:
    """Return whether a file begins as an MCAP file and does not end as one."""
    with open(path, "rb") as stream:
        start = stream.read(len(MAGIC))
        size = stream.seek(0, io.SEEK_END)
        stream.seek(max(0, size - len(MAGIC)))
        return start == MAGIC and (size < 2 * len(MAGIC) or stream.read() != MAGIC)


def salvaged(path: Path) -> Iterator[tuple[McapChannel, int, bytes]]:
    """Yield channel, receive time in ns and content of every message up to the first record that is not whole."""
    schemas: dict[int, tuple[str, str, str]] = {}
    channels: dict[int, McapChannel] = {}
    with open(path, "rb") as stream:
        size = stream.seek(0, io.SEEK_END)
        stream.seek(len(MAGIC))
        for kind, content in _unpacked(_records(stream, size)):
            try:
                if kind == _SCHEMA:
                    _read_schema(content, schemas)
                elif kind == _CHANNEL:
                    _read_channel(content, schemas, channels)
                elif kind == _MESSAGE:
                    channel, _, received = struct.unpack_from("<HIQ", content)
                    if channel in channels:
                        yield channels[channel], received, content[22:]
            except (struct.error, UnicodeDecodeError, Unsound):
                return


def _records(stream: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of the records; of a chunk that is cut, what is there of it."""
    while True:
        head = stream.read(9)
        if len(head) < 9:
            return
        kind, length = head[0], int.from_bytes(head[1:], "little")
        left = size - stream.tell()
        if kind == _DATA_END or (length > left and kind != _CHUNK):
            return
        if length > _MAX_CHUNK:
            return
        yield kind, stream.read(min(length, left))
        if length > left:
            return


def _unpacked(records: Iterator[tuple[int, bytes]]) -> Iterator[tuple[int, bytes]]:
    """Yield the records with chunks replaced by the records in them."""
    for kind, content in records:
        if kind != _CHUNK:
            yield kind, content
            continue
        if len(content) < 32:
            return
        (unpacked,) = struct.unpack_from("<Q", content, 16)
        (length,) = struct.unpack_from("<I", content, 28)
        start = 32 + length + 8
        data = _inflated(content[32 : 32 + length], content[start:], min(unpacked, _MAX_CHUNK))
        yield from _records(io.BytesIO(data), len(data))


def _inflated(compression: bytes, data: bytes, size: int) -> bytes:
    """Return what a decompressor makes of the start of a chunk; nothing where even that is unsound."""
    try:
        if compression == b"":
            return data[:size]
        if compression == b"lz4":
            from lz4.frame import LZ4FrameDecompressor

            return LZ4FrameDecompressor().decompress(data, max_length=size)
        if compression == b"zstd":
            return _zstd().ZstdDecompressor().decompress(data, max_length=size)
    except Exception:  # each package has its own errors; damaged bytes are the end of what can be read
        return b""
    return b""


def _zstd() -> Any:
    try:
        from compression import zstd  # type: ignore[import-not-found]  # Python 3.14
    except ImportError:
        from backports import zstd
    return zstd


def _read_schema(content: bytes, schemas: dict[int, tuple[str, str, str]]) -> None:
    (key,) = struct.unpack_from("<H", content)
    name, at = _text(content, 2)
    encoding, at = _text(content, at)
    definition, _ = _text(content, at)
    schemas[key] = name, encoding, definition


def _read_channel(content: bytes, schemas: dict[int, tuple[str, str, str]], channels: dict[int, McapChannel]) -> None:
    key, schema = struct.unpack_from("<HH", content)
    topic, _ = _text(content, 4)
    if schema in schemas:
        channels[key] = McapChannel(topic, *schemas[schema])


def _text(content: bytes, at: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", content, at)
    end = at + 4 + length
    if end > len(content):
        raise Unsound
    return content[at + 4 : end].decode(), end
