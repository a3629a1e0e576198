"""Masses in space: centres of mass and ellipsoids of inertia on the robot, identified and as described."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dynident.model.inertia import Inertia
from dynident.results.figures import Scene, mass_scene, scene_chart, scene_text
from dynident.results.report.sections.base import ReportSection, drawn
from dynident.results.report.subject import Subject

#: Views of a page without its script: name, direction of the eye about the vertical and above it, in rad.
VIEWS = (("from above", -1.01, 0.42), ("from the front", 0.0, 0.0), ("from the side", -0.5 * np.pi, 0.0))


@dataclass(frozen=True)
class MassDistribution(ReportSection):
    """The robot at the mean posture of the fit; left out where neither estimate nor description has inertias."""

    title: ClassVar = "Mass distribution"

    def context(self, subject: Subject) -> dict[str, Any]:
        estimate = subject.estimate
        links = estimate.model.robot.links
        stated = [link.inertia for link in links]
        sets: list[tuple[str, list[Inertia | None]]] = []
        if estimate.theta is not None:
            ten = np.asarray(estimate.theta)[: 10 * len(links)].reshape(-1, 10)
            sets.append(("identified", [Inertia.from_vector(row) for row in ten]))
        if any(inertia is not None and inertia.mass > 0 for inertia in stated):
            sets.append(("described", stated))
        scene = mass_scene(estimate.model.robot, estimate.middle, sets)
        if not scene.bodies:
            return {}
        return {
            "scene": scene_text(scene),
            "figures": _figures(scene),
            "left_out": ", ".join(scene.left_out),
            "covered": bool(scene.capsules),
        }


def _figures(scene: Scene) -> list[Any]:
    return [drawn(scene_chart(name.capitalize(), scene, *eye), "masses", name) for name, *eye in VIEWS]
