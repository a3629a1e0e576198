"""Recordings of ROS: ROS 1 bags, ROS 2 SQLite and MCAP recordings."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from dynident.data.formats._bag_source import bag_source, releases
from dynident.data.formats._bag_table import BagTable, header_of, state_topics, topic_problem
from dynident.data.formats.base import LogFormat
from dynident.errors import BadOption, UnknownChoice


@dataclass(frozen=True)
class Rosbag(LogFormat):
    """Recording of ROS 1 or ROS 2; columns ``t`` and, by the names of the joints, ``elbow.position``, ``elbow.effort``.

    Messages of other types give their numbers by place, ``wrench.force.x`` or ``data[0]``. Where several topics are
    read, the topic stands before the name, ``/joint_states:elbow.position``. Needs the extra ``ros``.

    Attributes:
        topics: Topics that are read; none for the one with states of joints (JointState, else DynamicJointState).
        stamps: Time of a message: ``header`` for the stamp that it carries, ``receive`` for when it was recorded.
        distro: ROS release whose message types hold where the recording defines none, such as ``humble``.
        salvage: Whether an .mcap file that was cut is read as far as it goes.
    """

    topics: tuple[str, ...] = ()
    stamps: str = "header"
    distro: str = ""
    salvage: bool = False

    suffixes: ClassVar = (".bag", ".db3", ".mcap")

    def __post_init__(self) -> None:
        if self.stamps not in ("header", "receive"):
            raise BadOption("stamps", self.stamps, "choose 'header' or 'receive'")
        if isinstance(self.topics, str):
            raise BadOption("topics", self.topics, "give a list of topics")
        object.__setattr__(self, "topics", tuple(self.topics))
        if self.distro and self.distro not in releases():
            raise UnknownChoice("ROS release", self.distro, list(releases()))

    @classmethod
    def takes(cls, path: str | Path) -> bool:
        """Return whether a path is a recording by its suffix, or a folder with a recording."""
        if os.path.isdir(path):
            return any(item.suffix.lower() in cls.suffixes for item in Path(path).iterdir())
        return super().takes(path)

    def open(self, path: str | Path) -> BagTable:
        source = bag_source(path, self.distro, self.salvage)
        topics = self._topics(str(path), source.topics())
        by = "stamps of the messages" if self.stamps == "header" else "receive times"
        return BagTable(
            path=str(path),
            sha256=source.digest(),
            header=header_of(str(path), source, topics),
            how=f"{source.kind}, {', '.join(topics)}, {by}",
            source=source,
            topics=tuple(topics),
            stamps=self.stamps,
        )

    def _topics(self, path: str, known: dict[str, str]) -> Sequence[str]:
        for topic in self.topics:
            if topic not in known:
                raise UnknownChoice("topic of the recording", topic, list(known))
        if self.topics:
            return self.topics
        states = state_topics(known)
        if len(states) != 1:
            raise topic_problem(path, known)
        return states
