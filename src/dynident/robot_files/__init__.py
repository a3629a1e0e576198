"""Robot models in files: from a URDF, a DH table, a JSON file or the name of a built-in robot to a Robot."""

from dynident.robot_files.reading import read_robot, shipped_robots

__all__ = ["read_robot", "shipped_robots"]
