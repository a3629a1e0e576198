"""The model: inertia, robot, regressor, dynamic model, base parameters."""
