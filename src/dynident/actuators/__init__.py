"""Actuators identified from commanded and measured positions, where a log has no torque and no current."""

from __future__ import annotations

from pathlib import Path

from dynident.files import is_json_of

#: What a file of actuators is.
KIND = "actuators"


def is_actuators(path: str | Path) -> bool:
    """Return whether a file states that it holds actuators."""
    return is_json_of(path, f'"kind": "{KIND}"')
