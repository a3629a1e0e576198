"""Draw the picture of the README: a real UR10e, measured and predicted torque, and its bodies as ellipsoids.

The case is that of ``dynident demo`` on the real arm, with plausible bodies (``bodies: plausible``): a log
determines base parameters, and many sets of bodies have these. The torques are those of the log to test on. Needs the
data that the case names and matplotlib.

  DYNIDENT_DATA=... python scripts/front_picture.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

import dynident as di
from dynident.results.figures import mass_scene

ROOT = Path(__file__).resolve().parent.parent
TARGET = ROOT / "docs" / "figures" / "front.png"
JOINTS = ("shoulder_lift_joint", "elbow_joint", "wrist_1_joint")
SECONDS = (2.0, 26.0)
POSTURE = (0.3, -1.0, 1.2, -1.6, -1.4, 0.3)
AZIMUTH, ELEVATION = 2.1, 0.3


def main() -> None:
    """Identify, and write the picture."""
    case = di.read_case(ROOT / "src" / "dynident" / "api" / "demo_data" / "ur10e.yaml")
    estimate = di.identify(
        case, estimator=di.ESTIMATORS.make("consistent", {"bodies": "plausible"}), trust=di.TrustOptions()
    )
    test = di.validate(estimate, [case.read(name) for name in case.test])
    figure = Figure(figsize=(10.0, 4.4), layout="constrained")
    grid = figure.add_gridspec(len(JOINTS), 2, width_ratios=(2.1, 1.0))
    for row, name in enumerate(JOINTS):
        draw_torque(figure.add_subplot(grid[row, 0]), test, name, is_first=row == 0)
    draw_bodies(figure.add_subplot(grid[:, 1]), estimate)
    total = test.total_relative_error
    figure.suptitle(
        f"UR10e, motor currents, test log: relative torque error {total:.1%}", fontsize=11, x=0.01, ha="left"
    )
    figure.savefig(TARGET, dpi=110)


def draw_torque(axis, test: di.Validation, name: str, is_first: bool) -> None:
    """Draw measured and predicted torque of a joint, and the residual with its 95 % band."""
    k = [fit.name for fit in test.joints].index(name)
    seen = (test.time >= SECONDS[0]) & (test.time <= SECONDS[1])
    time, (_, band) = test.time[seen], test.half_widths()
    axis.plot(time, test.measured[seen, k], color="0.6", linewidth=2.2, label="measured")
    axis.plot(time, test.predicted[seen, k], color="#c0392b", linewidth=0.9, label="predicted")
    axis.fill_between(time, -band[seen, k], band[seen, k], color="#2471a3", alpha=0.25, linewidth=0, label="95 % band")
    axis.plot(time, test.residual[seen, k], color="#2471a3", linewidth=0.6, label="residual")
    axis.set_ylabel(f"{name.removesuffix('_joint')}\n[N·m]", fontsize=8)
    axis.tick_params(labelsize=7)
    axis.margins(x=0)
    if is_first:
        axis.legend(fontsize=7, ncols=4, loc="upper right", frameon=False, bbox_to_anchor=(1.0, 1.28))
    if name == JOINTS[-1]:
        axis.set_xlabel("time [s]", fontsize=8)
    else:
        axis.tick_params(labelbottom=False)


def draw_bodies(axis, estimate: di.Estimate) -> None:
    """Draw the robot with the identified bodies as ellipsoids, those of its URDF dashed."""
    links = estimate.model.robot.links
    found = [di.Inertia.from_vector(row) for row in np.asarray(estimate.theta)[: 10 * len(links)].reshape(-1, 10)]
    scene = mass_scene(
        estimate.model.robot, np.array(POSTURE), [("identified", found), ("URDF", [link.inertia for link in links])]
    )
    side = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    ahead = np.array([np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)])
    view = np.array([side, np.cross(ahead, side)])
    for bone in scene.bones:
        axis.plot(*(view @ bone.T), color="0.82", linewidth=9, solid_capstyle="round", zorder=1)
    for body in scene.bodies:
        values, axes = np.linalg.eigh(view @ body.spread @ view.T)
        angle = np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))
        width, height = 2.0 * np.sqrt(np.maximum(values[::-1], 1e-6))
        is_stated = body.kind == 1
        style = {"facecolor": "none", "linestyle": "--", "edgecolor": "0.3", "linewidth": 0.8}
        if not is_stated:
            style = {"facecolor": "#2471a355", "edgecolor": "#2471a3", "linewidth": 1.0}
        centre = view @ body.centre
        axis.add_patch(Ellipse(centre, width, height, angle=angle, zorder=2 + is_stated, **style))
    axis.set_aspect("equal")
    axis.margins(0.12)
    axis.axis("off")
    axis.set_title("a set of bodies with these torques\n(URDF: dashed)", fontsize=8)


if __name__ == "__main__":
    main()
