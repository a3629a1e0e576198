"""Robot descriptions: file <-> Robot; the only files that know a format."""

from dynident.model.descriptions.base import read_robot, shipped_robots

__all__ = ["read_robot", "shipped_robots"]
