"""Robots that dynident has not seen, in layouts of the field, from a first look to a model held against logs unseen.

The plants are Pinocchio's, with bodies drawn about those of the robot model, friction at the motors and a controller
that follows. Of each the logs are drafted, the answers filled in that no log can tell, identified and validated. Beside
it stands the same case with the friction that is there. Reports, exports and ``--friction auto`` must run as well.

Needs Pinocchio, SciPy, and the extras parquet and ros.
Run: python -m benchmarks.strangers [ROBOT ...] [--short]
"""
