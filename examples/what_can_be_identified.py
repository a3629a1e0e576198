"""Which parameters of a robot can a motion tell at all?

    python what_can_be_identified.py [ROBOT]

ROBOT is a URDF, a DH table in YAML or a robot that ships with dynident; the default is a generic six-joint arm.
"""

import sys
from collections import Counter

import dynident

robot = dynident.read_robot(sys.argv[1] if len(sys.argv) > 1 else "generic-6r")
model = dynident.DynamicModel(robot, ["coulomb", "viscous", "offset"])
base = dynident.base_parameters(model)

print(f"{robot.name}: {robot.dof} joints, {len(base.parameters)} standard parameters, {base.count} base parameters")
for name, unit in zip(base.names, base.units, strict=True):
    print(f"  {name}  [{unit}]")
for verdict, count in Counter(base.verdicts).items():
    print(f"{count:4d} {verdict}")
