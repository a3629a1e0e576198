"""The key ``limits`` of a case file: bounds of joints that the robot description does not state, or states wrongly."""

from __future__ import annotations

from dataclasses import replace

from dynident.experiment.case_file.case_values import guarded
from dynident.model.documents.sections import Section
from dynident.model.robot import Robot

#: The bounds of a joint, by the names they have in the model.
QUANTITIES = ("lower", "upper", "velocity", "acceleration", "jerk", "effort", "effort_rate")


def robot_with_limits(top: Section, robot: Robot) -> Robot:
    """Return the robot with the bounds that the case states: one number for all joints, or one per joint.

    Raises:
        DescriptionError: A key that is no bound, another number of numbers than joints, or a bound that cannot be.
    """
    section = top.section("limits", QUANTITIES)
    names = robot.joint_names
    stated: dict[str, list[float]] = {}
    for quantity in QUANTITIES:
        if section.has(quantity):
            several = isinstance(section.value(quantity), list)
            values = section.numbers(quantity, len(names)) if several else [section.number(quantity)] * len(names)
            stated[quantity] = [float(value) for value in values]

    def bounded() -> Robot:
        joints = []
        for joint in robot.joints:
            if joint.name in names:
                own = {quantity: values[names.index(joint.name)] for quantity, values in stated.items()}
                joint = replace(joint, limits=replace(joint.limits, **own))  # noqa: PLW2901 - the one that is kept
            joints.append(joint)
        return replace(robot, joints=tuple(joints))

    return guarded(section.place(), bounded)
