"""The columns of a log by the profile of its maker, with what the user states in their place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dynident.data.formats import ColumnMap, Units
from dynident.data.formats._column_map import QUANTITY
from dynident.data.profiles import PROFILES, Channel, Profile
from dynident.errors import BadOption

#: Signals that have a side: those of motion and torque. A current is always the motor's.
SIDED = ("q", "dq", "ddq", "torque", "raw_torque", "q_ref", "dq_ref")


def profile_columns(
    profile: str | Profile,
    joints: Sequence[str],
    units: Mapping[str, str | tuple[str, ...]] | None = None,
    stated: Mapping[str, Any] | None = None,
) -> ColumnMap:
    """Return how the columns of a log become signals by a profile.

    Args:
        profile: Name of the profile, or the profile.
        joints: Names of the joints, in the order of their numbers.
        units: Units that stand in place of the profile's, by quantity; words of the case file.
        stated: Fields of :class:`ColumnMap`, by name, that stand in place of the profile's.

    Raises:
        UnknownChoice: No such profile.
        BadOption: A unit that only the user can know is missing, or a column is not what it is read as.
    """
    name = profile if isinstance(profile, str) else PROFILES.name_of(profile)
    found = PROFILES.make(profile)
    channels = found.read_channels()
    columns: dict[str, Any] = {
        signal: channels[signal].names(joints) if signal in channels else () for signal in QUANTITY
    }
    columns |= stated or {}
    _check(name, found, columns)
    used = {signal: _channel(found, signal, columns[signal]) for signal in QUANTITY if columns[signal]}
    words: dict[str, Any] = {"time": found.time_unit} if columns.get("time", found.time) == found.time else {}
    for signal, channel in used.items():
        quantity = QUANTITY[signal]
        if channel is None or quantity == "temperature" or quantity in words or quantity in (units or {}):
            continue
        if not channel.unit:
            step = f"state it (units: {{{quantity}: ...}}): {name} does not state it ({channel.note})"
            raise BadOption(f"units.{quantity}", None, step)
        words[quantity] = channel.unit
    motor = [s for s, channel in used.items() if channel is not None and channel.side == "motor" and s in SIDED]
    optional = [s for s, channel in channels.items() if not channel.needed and s not in (stated or {})]
    settings: dict[str, Any] = {"time": found.time, "motor": tuple(motor), "optional": tuple(optional)}
    words |= dict(units or {})
    settings["units"] = Units(**words)
    return ColumnMap(joints=tuple(joints), **(settings | columns))


def _check(name: str, profile: Profile, columns: Mapping[str, Any]) -> None:
    """Refuse columns of the profile that are read as another quantity than they are, such as currents as torques."""
    forced = columns.get("force", ())
    for signal, quantity in QUANTITY.items():
        for column in columns[signal] or ():
            known = [channel for channel in profile.channels if channel.matches(column)]
            if known and signal not in forced and quantity not in {QUANTITY[channel.signal] for channel in known}:
                step = f"in {name} it is a {QUANTITY[known[0].signal]}; map another column, or say force: [{signal}]"
                raise BadOption(signal, column, step)


def _channel(profile: Profile, signal: str, names: Sequence[str]) -> Channel | None:
    """Return the channel of the profile that the columns of a signal are; None for columns that it does not know."""
    for channel in profile.channels:
        if QUANTITY[channel.signal] == QUANTITY[signal] and all(channel.matches(name) for name in names):
            return channel
    return None
