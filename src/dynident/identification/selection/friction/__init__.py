"""Friction found from logs: the choice joint by joint, non-linear fields, load, and the delay of the torque."""
