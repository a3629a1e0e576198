"""Draw the pictures of the pages on symptoms and first steps, and write the figures beside them into the page.

All are made from the virtual arm of ``dynident demo``, whose log is right; each symptom is one fault put into it. Needs
matplotlib; about two minutes of a processor.

  python scripts/doc_pictures.py
"""

from __future__ import annotations

import re
import sys
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import dynident as di

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / "src" / "dynident" / "api" / "demo_data"
FIGURES = ROOT / "docs" / "figures"
FRICTION = ("coulomb", "viscous", "offset", "rotor_inertia")
NAMES = ("base_yaw", "shoulder_pitch", "elbow", "wrist_1", "wrist_2", "wrist_3")
TILT = (9.81 * np.sin(0.35), 0.0, -9.81 * np.cos(0.35))

Arrays = dict[str, Any]


@dataclass(frozen=True)
class Symptom:
    """A fault, and the joint at which it shows.

    Attributes:
        name: Name of its picture.
        joint: Index of the joint.
        fault: Returns the log with the fault.
        friction: Friction of the model.
        gravity: Gravity of the model where it is wrong.
        estimator: Estimator.
    """

    name: str
    joint: int
    fault: Callable[[Arrays], Arrays] = dict
    friction: tuple[str, ...] = FRICTION
    gravity: tuple[float, ...] | None = None
    estimator: str = "consistent"


def _changed(signal: str, joint: int, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Arrays], Arrays]:
    """Return a fault of one column of a signal."""

    def fault(log: Arrays) -> Arrays:
        values = np.array(log[signal])
        values[:, joint] = change(values[:, joint])
        return {**log, signal: values}

    return fault


def _late(log: Arrays) -> Arrays:
    return {**log, "torque": np.vstack([log["torque"][:3], log["torque"][:-3]])}


def _noisy(column: np.ndarray) -> np.ndarray:
    return column + np.random.default_rng(0).normal(0.0, 20.0, len(column))


SYMPTOMS = (
    Symptom("right", 1),
    Symptom("jumps", 0, friction=("viscous", "offset", "rotor_inertia")),
    Symptom("gravity", 0, gravity=TILT),
    Symptom("delay", 0, _late),
    Symptom("sign", 3, _changed("torque", 3, np.negative)),
    Symptom("saturation", 2, _changed("torque", 2, lambda column: np.clip(column, -25.0, 25.0))),
    Symptom("noise", 1, _changed("torque", 1, _noisy)),
    Symptom("encoder", 2, _changed("q", 2, lambda column: np.round(column / 0.01) * 0.01)),
    Symptom("short", 2, lambda log: {name: values[:400] for name, values in log.items()}, estimator="wls"),
)


def main() -> None:
    """Draw all pictures, or those that are named, and write the table."""
    chosen = [one for one in SYMPTOMS if one.name in sys.argv[1:] or not sys.argv[1:]]
    rows = {one.name: draw(one, FIGURES) for one in chosen}
    if not sys.argv[1:]:
        page = ROOT / "docs" / "symptoms.md"
        page.write_text(with_table(page.read_text(encoding="utf-8"), rows), encoding="utf-8")


def draw(symptom: Symptom, folder: Path) -> str:
    """Write the picture of a symptom and return its line of the table."""
    log = di.read_log(DATA / "run.csv")
    arrays = symptom.fault({"time": np.array(log.time), "q": np.array(log.q), "torque": np.array(log.torque)})
    robot = di.read_robot(str(DATA / "arm.urdf"))
    if symptom.gravity is not None:
        robot = robot.with_gravity(symptom.gravity)
    border = int(0.67 * len(arrays["time"]))
    train, test = (
        {name: values[part] for name, values in arrays.items()} for part in (slice(border), slice(border, None))
    )
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "not accepted")  # the faults are meant
        estimate = di.identify(di.DynamicModel(robot, symptom.friction), train, symptom.estimator)
    validation = di.validate(estimate, test)
    if symptom.name == "right":
        figure = estimate.plot_torques(validation, joints=NAMES[1:4])
        figure.set_size_inches(7.0, 4.5)
        figure.savefig(folder / "quickstart.png", dpi=75)
        draw_mujoco(estimate, validation, folder)
    figure = estimate.plot_torques(validation, joints=[NAMES[symptom.joint]])
    figure.set_size_inches(7.0, 2.1)
    figure.savefig(folder / f"symptom-{symptom.name}.png", dpi=75)
    error = validation.joints[symptom.joint].relative_error
    quality = estimate.provenance["log_quality"]
    found = dict.fromkeys(
        f"{one['name']} ({one['severity']})"
        for one in sorted(
            (one for log in quality for one in log["findings"]), key=lambda one: one["severity"] == "note"
        )
    )
    told = ", ".join(list(found)[:3]) or "none"
    consistent = "yes" if estimate.consistency.consistent else "no"
    return (
        f"| [{symptom.name}](figures/symptom-{symptom.name}.png) | {NAMES[symptom.joint]} | {100 * error:.2g} "
        f"| {estimate.condition_number:.2g} | {consistent} | {told} |"
    )


def draw_mujoco(estimate: di.Estimate, test: di.Validation, folder: Path) -> None:
    """Draw the torques by MuJoCo, from the exported model, and those of the identified one, on the motion of a test."""
    import mujoco
    from matplotlib.figure import Figure

    with tempfile.TemporaryDirectory() as place:
        estimate.export("mjcf", Path(place) / "arm.xml")
        model = mujoco.MjModel.from_xml_path(str(Path(place) / "arm.xml"))
    data = mujoco.MjData(model)
    q, dq = np.asarray(test.q), np.asarray(test.dq)
    ddq = np.gradient(dq, test.time, axis=0)
    found = np.zeros_like(q)
    for row in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[row], dq[row], ddq[row]
        mujoco.mj_inverse(model, data)
        found[row] = data.qfrc_inverse
    figure = Figure(figsize=(7.0, 3.6), layout="constrained")
    own = estimate.predict(q, dq, ddq)
    for axis, k in zip(figure.subplots(2, 1, sharex=True), (1, 2), strict=True):
        axis.plot(test.time, own[:, k], color="0.6", linewidth=3, label="estimate.predict")
        axis.plot(test.time, found[:, k], color="C3", linewidth=0.9, label="MuJoCo, mj_inverse of the exported model")
        axis.set_ylabel(f"{NAMES[k]} [N·m]")
    figure.axes[0].legend(fontsize="small", ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)
    figure.axes[1].set_xlabel("time [s]")
    figure.savefig(folder / "into-mujoco.png", dpi=75)


def with_table(page: str, rows: dict[str, str]) -> str:
    """Return the page with the table of figures renewed."""
    head = "| picture | joint | test error [%] | condition number | consistent | findings of the log checks |\n"
    head += "|---|---|---|---|---|---|\n"
    table = f"<!-- symptoms -->\n\n{head}" + "\n".join(rows.values()) + "\n\n<!-- symptoms: end -->"
    return re.sub(r"<!-- symptoms -->.*<!-- symptoms: end -->", lambda _: table, page, flags=re.DOTALL)


if __name__ == "__main__":
    main()
