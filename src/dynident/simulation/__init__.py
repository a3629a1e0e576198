"""The virtual robot: its plant, and the compiled loops that drive it."""
