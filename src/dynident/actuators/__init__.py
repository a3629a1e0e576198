"""Actuators identified from commanded and measured positions, where a log has no torque and no current."""
