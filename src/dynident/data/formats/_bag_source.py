"""Recordings of ROS as a stream of messages: ROS 1 bags, ROS 2 folders, .db3 and .mcap files, and cut .mcap files."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Collection, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from dynident.data.formats._arrays import checked_file
from dynident.data.formats._bag_decoding import Decoder, check_arrays, check_texts, common_types
from dynident.data.formats._bag_messages import Numbers
from dynident.data.formats._mcap_salvage import McapChannel, is_cut, salvaged
from dynident.data.formats.base import check_size
from dynident.errors import BadOption, FileError, LogFormatError, MissingDependency
from dynident.files import sha256_of, unreadable

_MAX_BYTES = 1 << 40
_STORAGE = (".mcap", ".db3")
_IDL_HEAD = re.compile(r"^={80}\nIDL: .*$", re.MULTILINE)  # what ROS writes before each definition in IDL


@dataclass(frozen=True)
class BagSource:
    """A recording.

    Attributes:
        path: The file or folder as it was given, for messages.
        place: The file or folder that is read.
        distro: ROS release whose message types are taken where the recording defines none; empty for that which the
            recording names, or the types that are the same in all releases of ROS 2.
        cut: Whether it is an .mcap file without an end, to be read as far as it goes.
    """

    path: str
    place: Path
    distro: str = ""
    cut: bool = False

    @property
    def kind(self) -> str:
        """What it is, in words."""
        if self.place.is_dir():
            return "ROS 2 recording"
        return {".bag": "ROS 1 bag", ".db3": "ROS 2 bag (SQLite)"}.get(self.place.suffix.lower(), "ROS 2 bag (MCAP)")

    def digest(self) -> str:
        """Return the hash of the file; of a folder, of the names and hashes of its files."""
        if not self.place.is_dir():
            return checked_file(self.place, _MAX_BYTES)
        for file in filter(Path.is_file, self.place.iterdir()):
            check_size(file, _MAX_BYTES, "split it into several logs")
        return sha256_of(self.place)

    def topics(self) -> dict[str, str]:
        """Return the type of the messages of every topic.

        Raises:
            LogFormatError: It is no sound recording.
        """
        if self.cut:
            return {channel.topic: channel.msgtype for channel, _, _ in salvaged(self.place)}
        found: dict[str, str] = {}
        try:
            for part in self._reader().readers:  # opened one by one, whose definitions are not parsed yet
                with part:
                    definitions = [connection.msgdef for connection in part.connections]
                    check_texts(self.path, ((one.data, one.format.name == "IDL") for one in definitions))
                    found |= {connection.topic: connection.msgtype for connection in part.connections}
            if not all(isinstance(word, str) for pair in found.items() for word in pair):
                raise TypeError("a name or a type of a topic that is no text")  # SQLite keeps bytes as well
        except Exception as error:
            raise self._damaged(error) from error
        return found

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, Numbers]]:
        """Yield topic, receive time in ns and numbers of messages, in the order in which they were received.

        Raises:
            LogFormatError: It is damaged.
        """
        try:
            yield from self._salvaged(topics) if self.cut else self._read(topics)
        except Exception as error:  # the parsers let any error out of a damaged file
            raise self._damaged(error) from error

    def frame(self, topic: str) -> str:
        """Return the frame in the header of the first message of a topic; empty where it has none, or the file is cut.

        Raises:
            LogFormatError: It is damaged.
        """
        if self.cut:
            return ""
        try:
            with self._reader() as reader:
                chosen = [connection for connection in reader.connections if connection.topic == topic]
                for connection, _, data in reader.messages(chosen):
                    message = reader.deserialize(data, connection.msgtype)
                    return str(getattr(getattr(message, "header", None), "frame_id", ""))
        except Exception as error:
            raise self._damaged(error) from error
        return ""

    def _read(self, topics: Collection[str]) -> Iterator[tuple[str, int, Numbers]]:
        with self._reader() as reader:
            chosen = [connection for connection in reader.connections if connection.topic in topics]
            known = reader.typestore.fielddefs
            for connection in chosen:
                if connection.msgtype not in known:
                    evidence = f"the recording does not define the message type '{connection.msgtype}'"
                    step = "name the ROS release, such as format: {rosbag: {distro: humble}}, or another topic"
                    raise LogFormatError(self.path, None, evidence, step)
            check_arrays(self.path, known, (connection.msgtype for connection in chosen))
            decode = Decoder(reader.deserialize)
            for connection, received, data in reader.messages(chosen) if chosen else ():
                yield connection.topic, received, decode(data, connection.topic, connection.msgtype)

    def _salvaged(self, topics: Collection[str]) -> Iterator[tuple[str, int, Numbers]]:
        known: set[McapChannel] = set()
        store = _rosbags().get_typestore(_rosbags().Stores.EMPTY)
        decode = Decoder(store.deserialize_cdr)
        for channel, received, data in salvaged(self.place):
            if channel.topic not in topics:
                continue
            if channel not in known:
                check_texts(self.path, [(channel.definition, channel.encoding != "ros2msg")])
                store.register(_types(channel))
                check_arrays(self.path, store.fielddefs, (channel.msgtype,))
                known.add(channel)
            yield channel.topic, received, decode(data, channel.topic, channel.msgtype)

    def _reader(self) -> Any:
        _rosbags()
        from rosbags.highlevel import AnyReader

        types: Any = _TypesOfRelease(self.place, self.distro)
        return AnyReader([self.place], default_typestore=types)

    def _damaged(self, error: Exception) -> Exception:
        if isinstance(error, LogFormatError | FileError | BadOption | MissingDependency):
            return error
        if isinstance(error, PermissionError):
            return unreadable(self.path, error)
        words = " ".join(str(error).split())[:200]
        evidence = f"no recording of ROS, or a damaged one ({words or type(error).__name__})"
        return LogFormatError(self.path, None, evidence, "record it again, or repair it with the tools of ROS")


def bag_source(path: str | Path, distro: str, salvage: bool) -> BagSource:
    """Return the recording at a path.

    Args:
        path: A file, or the folder of a ROS 2 recording.
        distro: ROS release for recordings that do not define their messages; empty for none.
        salvage: Whether a cut .mcap file is to be read as far as it goes.

    Raises:
        FileError: It cannot be read at all.
        LogFormatError: It is cut, or a folder in which there is no recording.
        MissingDependency: The package ``rosbags`` is not installed.
    """
    _rosbags()
    place = Path(path)
    try:
        place.stat()
        if place.is_dir():
            place = _storage(path, place)
        pieces = sorted(place.glob("*.mcap")) if place.is_dir() else [place]
        cut = [piece for piece in pieces if piece.suffix.lower() == ".mcap" and is_cut(piece)]
    except OSError as error:
        raise unreadable(path, error) from error
    if not cut:
        return BagSource(str(path), place, distro)
    if not salvage:
        evidence = f"'{cut[0].name}' is cut: it has no end"
        step = "read what is there with --format rosbag --format-option salvage=true, in a case with format: "
        step += "{rosbag: {salvage: true}}"
        raise LogFormatError(path, None, evidence, step)
    if len(pieces) > 1:
        raise LogFormatError(path, None, f"'{cut[0].name}' of {len(pieces)} files is cut", "give the files one by one")
    return BagSource(str(path), cut[0], distro, cut=True)


def _storage(path: str | Path, folder: Path) -> Path:
    """Return the folder of a recording, or the one file in it where its metadata were never written."""
    if (folder / "metadata.yaml").is_file():
        return folder
    found = [item for item in sorted(folder.iterdir()) if item.suffix.lower() in _STORAGE]
    if len(found) == 1:
        return found[0]
    what = "no recording" if not found else f"{len(found)} recordings and no metadata.yaml"
    raise LogFormatError(path, None, f"a folder with {what}", "give one .mcap, .db3 or .bag file")


def releases() -> Mapping[str, str]:
    """Return the name in ``rosbags`` of every release of ROS, such as ``humble``.

    Raises:
        MissingDependency: The package ``rosbags`` is not installed.
    """
    stores = _rosbags().Stores
    return {store.name.partition("_")[2].lower(): store.name for store in stores if store.name.startswith("ROS")}


@dataclass(frozen=True)
class _TypesOfRelease:
    """Message types for a recording that defines none, looked up when they are asked for.

    Attributes:
        place: The recording.
        distro: ROS release; empty for that which the recording names.
    """

    place: Path
    distro: str

    @cached_property
    def fielddefs(self) -> Mapping[str, Any]:
        """Constants and fields of every type; without a release those of the types that are the same in all."""
        typesys, release = _rosbags(), self.distro or _named_release(self.place)
        if release:
            return typesys.get_typestore(typesys.Stores[releases()[release]]).fielddefs
        stores = [name for name in releases().values() if name.startswith("ROS2")]
        return common_types([typesys.get_typestore(typesys.Stores[name]).fielddefs for name in stores])


def _named_release(place: Path) -> str:
    """Return the ROS release that the SQLite files of a recording name; empty where it is none or not known."""
    for file in sorted(place.glob("*.db3")) if place.is_dir() else [place]:
        with (
            suppress(sqlite3.Error),
            closing(sqlite3.connect(f"{file.resolve().as_uri()}?immutable=1", uri=True)) as base,
        ):
            names = [name for (name,) in base.execute("SELECT ros_distro FROM schema LIMIT 1")]
            if names and names[0] in releases():
                return str(names[0])
    return ""


def _types(channel: McapChannel) -> Any:
    typesys = _rosbags()
    if channel.encoding == "ros2msg":
        return typesys.get_types_from_msg(channel.definition, channel.msgtype)
    types: dict[str, Any] = {}
    for text in _IDL_HEAD.split(channel.definition):
        types |= typesys.get_types_from_idl(text) if text.strip() else {}
    return types


def _rosbags() -> Any:
    try:
        from rosbags import typesys
    except ImportError as error:
        raise MissingDependency("reading recordings of ROS", "rosbags", "ros") from error
    return typesys
