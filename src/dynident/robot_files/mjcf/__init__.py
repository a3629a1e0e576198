"""MJCF: the kinematic and inertial part of MuJoCo's models, read as its compiler reads it (documentation of 4.0)."""
