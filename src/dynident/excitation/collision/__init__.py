"""The room of a robot: floor, obstacles and tool, and how far the links are from them and from each other."""
