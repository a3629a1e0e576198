"""Figures 4 to 9 of the article, as files under its numbers, where the report is about its robot."""

from __future__ import annotations

from collections.abc import Iterator

from dynident.results.figures import convergence_chart, path_chart, tool_path, torque_overview, trajectory_chart
from dynident.results.report.sections.base import Drawing, drawn
from dynident.results.report.sections.convergence import traces_of
from dynident.results.report.subject import Dataset, Subject

#: Name of the article's robot, as it ships.
ROBOT = "er16"


def article_figures(subject: Subject) -> tuple[Drawing, ...]:
    """Return the figures of the article; none for another robot or a fit of several logs.

    Figures 4, 5 and 7 show the motion of the fit and its torques, 8 and 9 those of the first test, 6 the objective over
    the iterations of the estimate's search. One for which the estimate has nothing is left out.
    """
    if subject.estimate.model.robot.name != ROBOT or len(subject.estimate.train.logs) != 1:
        return ()
    return tuple(_numbered(subject))


def _numbered(subject: Subject) -> Iterator[Drawing]:
    robot, train = subject.estimate.model.robot, [data for data in subject.datasets if not data.held_out]
    for data in train:
        yield _trajectory(subject, data, "Excitation trajectory", "figure-4-excitation-trajectory")
        path = path_chart("Excitation trajectory in space", tool_path(robot, data.validation.q))
        yield drawn(path, "figure-5-excitation-trajectory-in-space")
    traces, optimum = traces_of(subject)
    if traces:
        chart = convergence_chart(traces, optimum, subject.comparison.objective)
        yield drawn(chart, "figure-6-convergence")
    for data in train:
        yield _torques(data, "Torques of the fit", "figure-7-torques-of-the-fit")
    for data in subject.held_out[:1]:
        yield _trajectory(subject, data, "Validation trajectory", "figure-8-validation-trajectory")
        yield _torques(data, "Torques of the validation", "figure-9-torques-of-the-validation")


def _trajectory(subject: Subject, data: Dataset, title: str, name: str) -> Drawing:
    v, robot = data.validation, subject.estimate.model.robot
    kinds = [joint.kind for joint in robot.active]
    return drawn(trajectory_chart(title, robot.joint_names, kinds, v.time, v.q, v.dq, v.starts), name)


def _torques(data: Dataset, title: str, name: str) -> Drawing:
    v = data.validation
    joints = [(fit.name, fit.unit) for fit in v.joints]
    return drawn(torque_overview(title, joints, v.time, v.measured, v.predicted, v.starts), name)
