"""Profiles of makers' logs, a family: which columns there are, and what each of them means."""

from __future__ import annotations

from functools import lru_cache

from dynident.data.profiles.base import Channel, Profile, pattern_names
from dynident.plugins import Family

PROFILES: Family[Profile] = Family("dynident.data.profiles", Profile, "log profile")

#: Names in common use for torques that are not measured.
_USUAL = tuple(
    Channel(f"{word}{mark}", "torque", kind, read=False, note=f"'{word}' is the usual name of a {kind} torque")
    for kind, words in (
        ("commanded", ("tau_des", "tau_d", "tau_cmd", "tau_c", "tau_ref", "torque_des", "torque_cmd", "torque_ref")),
        ("model", ("tau_model", "torque_model", "tau_est", "torque_est")),
    )
    for word in words
    for mark in ("{0}", "_{0}", "[{0}]")
)

__all__ = ["PROFILES", "Channel", "Profile", "pattern_names", "unmeasured"]


@lru_cache(maxsize=4096)
def unmeasured(column: str) -> tuple[str, Channel] | None:
    """Return where a column is known from that holds a commanded value or one of a model, and its channel.

    None for a column that no profile knows, or that is measured in one of them.
    """
    known = [(name, channel) for name in PROFILES.names() for channel in PROFILES.get(name).channels]
    found = [(name, channel) for name, channel in known if channel.matches(column)]
    found = found or [("common use", channel) for channel in _USUAL if channel.matches(column)]
    if any(channel.kind == "measured" for _, channel in found):
        return None
    return next(iter(found), None)
