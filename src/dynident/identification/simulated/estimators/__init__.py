"""Estimators that simulate the robot."""
