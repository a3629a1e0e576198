"""Which profile a header fits: every profile with what speaks for it, the best first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dynident.data.profiles import PROFILES
from dynident.data.profiles.base import Channel, Profile


@dataclass(frozen=True)
class ProfileFit:
    """A profile whose time and needed columns are all in a header.

    Attributes:
        name: Its name.
        profile: The profile.
        joints: Joints of the robot that the header has, in the robot's order.
        channels: Channels that are read and that the header has for these joints.
        known: Columns of the header that the profile knows.
        total: Columns of the header.
    """

    name: str
    profile: Profile
    joints: tuple[str, ...]
    channels: tuple[Channel, ...]
    known: int
    total: int

    @property
    def effort(self) -> Channel | None:
        """The channel of torque or current; None where the profile reads none."""
        return next((channel for channel in self.channels if channel.signal in ("torque", "current")), None)

    def states(self, signal: str) -> bool:
        """Return whether the profile says in which unit a signal is."""
        return any(channel.signal == signal and channel.unit for channel in self.channels)

    def why(self) -> str:
        """Return in words what speaks for it."""
        names = ", ".join(channel.pattern for channel in self.channels)
        return f"the header has '{self.profile.time}' and {names}; {self.known} of {self.total} columns are known to it"


def fitting_profiles(header: Sequence[str], joints: Sequence[str]) -> list[ProfileFit]:
    """Return the profiles that a header fits, the one that knows most of its columns first.

    Args:
        header: Names of the columns.
        joints: Names of the joints of the robot, in order.
    """
    found = []
    for name in PROFILES.names():
        profile = PROFILES.make(name)
        if profile.time not in header:
            continue
        read = profile.read_channels()
        there = _joints_of(read["q"], header, joints, is_alone=not {"torque", "current"} & read.keys())
        if not there:
            continue
        channels = [c for c in read.values() if set(c.names(there)) <= set(header)]
        if any(c.needed and c not in channels for c in read.values()):
            continue
        if name == "ur_ros2" and not is_universal(joints):
            continue  # the columns are those of every robot under ROS
        known = 1 + sum(any(c.matches(column) for c in profile.channels) for column in header)
        found.append(ProfileFit(name, profile, there, tuple(channels), known, len(header)))
    return sorted(found, key=lambda fit: (-fit.known, fit.name != "ur_ros2", fit.name))


def equally_good(fits: Sequence[ProfileFit]) -> list[ProfileFit]:
    """Return the fits that are as good as the first; more than one has to be asked about."""
    return [fit for fit in fits if fit.known == fits[0].known] if fits else []


def is_universal(joints: Sequence[str]) -> bool:
    """Return whether joints have the names that the drivers of Universal Robots give them, with any prefix."""
    return all(any(joint.endswith(name) for joint in joints) for name in ("shoulder_pan_joint", "wrist_1_joint"))


def _joints_of(channel: Channel, header: Sequence[str], joints: Sequence[str], is_alone: bool) -> tuple[str, ...]:
    """Return the joints that the positions of a profile are there for; with numbers it takes all of them.

    Where positions have no torque beside them, a gripper that the robot model lacks may be the last of them.
    """
    if "{joint}" in channel.pattern:
        return tuple(j for j in joints if channel.names([j])[0] in header)
    count = sum(channel.matches(column) for column in header)
    fits = count >= len(joints) if is_alone else count == len(joints)
    return tuple(joints) if fits and set(channel.names(joints)) <= set(header) else ()
