"""Derive the built-in er16.yaml: a physically consistent ER-16 whose joints 1-3 come close to the torques of Table 2.

Table 2 of the article is no possible robot, and it says nothing of links 4-6. This script looks for six possible
bodies:

1. Links 4-6 are plausible wrist bodies of our own, locked at 0 as in the article.
2. Links 1-3 and the friction of joints 1-3 minimise the misfit e, with e^2 the sum over the joints of (root mean square
   torque difference to Table 2 over beta_1 / standard deviation of Table 2's torque)^2, subject to
   P - 1e-3 tr(P) I >= 0 for the pseudo-inertia P of each link, mass spread by 0.08 m or more in every direction (no
   point masses), Fc >= 0.5 N m, Fv >= 0.5 N m s/rad, masses of 1 to 200 kg.
3. That optimum has masses at their bounds and leaves some parameters open. So among all robots with a misfit up to 2 %
   above it, the one is taken whose bodies are closest to plausible ones: least sum of |P - P0|^2 / m0^2.

Usage: python scripts/derive_er16.py      rewrites src/dynident/robot_files/robots/er16.yaml and prints what was reached
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import clarabel as clarabel_module
import numpy as np
import scipy.sparse

from dynident.arrays import Array
from dynident.errors import SolverFailed
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.files import write_atomically
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.inertia import PSEUDO_BASIS, Inertia
from dynident.model.joint import Joint
from dynident.model.reduction import triangle_of
from dynident.model.robot import Link, Robot
from dynident.robot_files.formats.dh import modified_pose
from dynident.studies import er16_article as article

clarabel: Any = clarabel_module  # it ships no types

TARGET = Path(__file__).resolve().parent.parent / "src/dynident/robot_files/robots/er16.yaml"

#: Smallest eigenvalue of each P in shares of its trace; the solver keeps a little more, which rounding may take.
MARGIN, KEPT_MARGIN = 1e-3, 1.02e-3
#: Smallest standard deviation of a link's mass in any direction, in m; smallest Fc in N m and Fv in N m s/rad; smallest
#: and largest mass in kg; share of the misfit given up for plausible bodies.
SPREAD, FLOOR, MASSES, SLACK = 0.08, 0.5, (1.0, 200.0), 0.02
#: Size of the parameters, which keeps the solver's numbers near one.
UNIT = 30.0


def cylinder(mass: float, centre: tuple[float, float, float], axis: int, radius: float, length: float) -> Inertia:
    """Return a solid cylinder along one frame axis."""
    moments = np.full(3, mass * (3 * radius**2 + length**2) / 12)
    moments[axis] = mass * radius**2 / 2
    return Inertia.from_centre_of_mass(mass, centre, np.diag(moments))


#: Plausible bodies of links 1-3, to which the solution is pulled (our assumption): column, upper arm, elbow.
PLAUSIBLE = (
    cylinder(60.0, (0.05, 0.0, 0.1), 2, 0.2, 0.4),
    cylinder(80.0, (0.3, 0.0, 0.0), 0, 0.1, 0.7),
    cylinder(25.0, (0.1, 0.1, 0.0), 1, 0.12, 0.5),
)

#: The wrist as it ships (our assumption): forearm tube behind the wrist centre, wrist, flange.
WRIST = (
    cylinder(5.0, (0.0, 0.0, 0.2), 2, 0.08, 0.4),
    cylinder(2.5, (0.0, 0.0, 0.0), 1, 0.075, 0.16),
    cylinder(1.0, (0.0, 0.0, -0.08), 2, 0.07, 0.12),
)

#: What the article does not state of joints 1-6, all our assumption: limits (rad, rad/s, rad/s^2, rad/s^3, N m, N m/s);
#: gear ratio, rotor inertia (kg m^2), joint torque per motor current (N m/A). Friction of joints 4-6: Fc in N m, Fv in
#: N m s/rad.
LIMITS = (
    (-2.97, 2.97, 3.0, 8.0, 80.0, 1600.0, 30000.0),
    (-2.4, 1.3, 2.6, 8.0, 80.0, 1600.0, 30000.0),
    (-1.9, 2.2, 3.0, 8.0, 80.0, 900.0, 20000.0),
    (-3.14, 3.14, 5.5, 30.0, 300.0, 120.0, 3000.0),
    (-2.0, 2.0, 5.5, 30.0, 300.0, 90.0, 2500.0),
    (-6.28, 6.28, 7.5, 45.0, 450.0, 50.0, 1500.0),
)
DRIVES = (
    (121.0, 0.0, 96.0),
    (153.0, 0.0, 122.0),
    (121.0, 0.0, 72.0),
    (81.0, 1.5e-4, 33.0),
    (80.0, 1e-4, 28.0),
    (50.0, 6e-5, 15.0),
)
WRIST_FRICTION = ((3.5, 4.5), (3.0, 3.5), (2.0, 2.0))


@dataclass(frozen=True)
class Target:
    """Table 2's torques over beta_1, reduced.

    Attributes:
        robot: The six-axis ER-16 of Table 1, without inertias.
        model: Joints 1-3 with sharp Coulomb and viscous friction, joints 4-6 locked.
        motion: beta_1.
        beta: Table 2, shape (21,).
        torque: Its torques, shape (N, 3), in N m.
        triangle: R with |R (beta' - beta)| = misfit, shape (21, 21).
        grouping: Base inertial parameters of the locked robot from those of all six links, shape (15, 60).
    """

    robot: Robot
    model: DynamicModel
    motion: Motion
    beta: Array
    torque: Array
    triangle: Array
    grouping: Array

    def shares(self, beta: Array) -> Array:
        """Return root mean square difference to Table 2 over standard deviation of Table 2, per joint, shape (3,)."""
        return np.sqrt(np.mean((self.predict(beta) - self.torque) ** 2, axis=0)) / self.torque.std(axis=0)

    def correlations(self, beta: Array) -> Array:
        """Return the correlation (18) with the torques of Table 2, per joint, shape (3,)."""
        other = self.predict(beta)
        return np.array([np.corrcoef(other[:, i], self.torque[:, i])[0, 1] for i in range(3)])

    def predict(self, beta: Array) -> Array:
        """Return the torques of base parameters over beta_1, shape (N, 3)."""
        independent = base_parameters(self.model).independent
        return self.model.regressor(self.motion)[..., independent] @ beta


def kinematics() -> Robot:
    """Return the ER-16 of Table 1, without inertias."""
    joints = tuple(
        Joint(f"joint{i + 1}", "revolute", i - 1, *modified_pose(a, alpha, d, theta), axis=np.array([0.0, 0.0, 1.0]))
        for i, (alpha, a, d, theta) in enumerate(article.TABLE_1)
    )
    return Robot("er16", tuple(Link(f"link{i + 1}") for i in range(6)), joints, np.array(article.GRAVITY))


def article_target() -> Target:
    """Return Table 2's torques over beta_1, reduced."""
    robot = kinematics()
    model = DynamicModel(robot.locked(article.LOCKED), (Coulomb(width=0.0), Viscous()))
    base = base_parameters(model)
    time = np.arange(article.SAMPLES) / article.RATE
    motion = Motion(*FourierSeries.from_table(list(article.BETA_1), article.PERIOD).evaluate(time))
    beta = np.array([article.TABLE_2[model.parameters[k].name] for k in base.independent])
    rows = model.regressor(motion)[..., base.independent]
    torque = rows @ beta
    scaled = rows / torque.std(axis=0)[:, None] / np.sqrt(len(torque))
    grouping = base.matrix[:15, : model.inertial_count] @ _merging(robot)
    return Target(robot, model, motion, beta, torque, triangle_of(scaled.reshape(-1, len(beta))), grouping)


def _merging(robot: Robot) -> Array:
    """Return the matrix (30, 60) from the parameters of all links to those with joints 4-6 locked."""
    columns = []
    for k in range(60):
        theta = np.eye(60)[k].reshape(6, 10)
        links = tuple(Link(f"link{i + 1}", Inertia.from_vector(ten)) for i, ten in enumerate(theta))
        nominal = Robot("er16", links, robot.joints).locked(article.LOCKED).nominal
        assert nominal is not None
        columns.append(nominal)
    return np.array(columns).T


def closest(
    target: Target,
    wrist: tuple[Inertia, ...] = WRIST,
    margin: float = KEPT_MARGIN,
    spread: float = SPREAD,
    floor: float = FLOOR,
    limit: float | None = None,
) -> tuple[Array, float]:
    """Return (30 inertial parameters of links 1-3, then Fc and Fv of joints 1-3) and the misfit.

    Args:
        target: What to come close to.
        wrist: Given bodies of links 4-6.
        margin: Smallest eigenvalue of each P in shares of its trace.
        spread: Smallest standard deviation of a link's mass in any direction, in m.
        floor: Smallest Fc and Fv.
        limit: Largest misfit, up to which the bodies closest to plausible ones are sought; None seeks the least misfit.

    Raises:
        SolverFailed: Clarabel reports anything but a solution.
    """
    matrix = np.zeros((21, 36))
    matrix[:15, :30], matrix[15:, 30:] = target.grouping[:, :30], np.eye(6)
    rest = target.beta.copy()
    rest[:15] -= target.grouping[:, 30:] @ np.concatenate([body.vector for body in wrist])
    matrix, rest = target.triangle @ matrix, target.triangle @ rest
    # Variables (x, t): |matrix x - rest| <= t, so the misfit is never squared; x in units of UNIT for the solver.
    matrix *= UNIT
    rows, offset, cones = _conditions(margin, spread, floor)
    ball = np.zeros((22, 37))
    ball[0, 36], ball[1:, :36] = -1.0, -matrix
    cones.append(clarabel.SecondOrderConeT(22))
    quadratic, linear = np.zeros((37, 37)), np.zeros(37)
    if limit is None:
        linear[36] = 1.0
    else:
        last = np.zeros((1, 37))
        last[0, 36] = 1.0
        rows, offset = np.concatenate([last, rows]), np.concatenate([[limit], offset])
        cones[0] = clarabel.NonnegativeConeT(13)
        for i, body in enumerate(PLAUSIBLE):
            ten = slice(10 * i, 10 * i + 10)
            to_pseudo = PSEUDO_BASIS.reshape(10, 16).T / body.mass
            quadratic[ten, ten] = UNIT**2 * to_pseudo.T @ to_pseudo
            linear[ten] = -quadratic[ten, ten] @ body.vector / UNIT
    settings: Any = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-7  # 1e-8 depends on the machine's rounding
    rows, offset = np.concatenate([rows, ball]), np.concatenate([offset, [0.0], -rest])
    upper = scipy.sparse.csc_matrix(np.triu(quadratic))
    found = clarabel.DefaultSolver(upper, linear, scipy.sparse.csc_matrix(rows), offset, cones, settings).solve()
    if str(found.status) != "Solved":
        raise SolverFailed("the ER-16 projection (Clarabel)", f"status {found.status}", "loosen a condition")
    x = np.array(found.x)[:36]
    return UNIT * x, float(np.linalg.norm(matrix @ x - rest))


def _conditions(margin: float, spread: float, floor: float) -> tuple[Array, Array, list[Any]]:
    """Return A, b and the cones of b - A (x, t): friction, masses, then two matrices of links 1-3.

    They are P - margin tr(P) I and P - spread^2 m diag(1, 1, 1, 0): by Schur's complement the second moment about the
    centre of mass is at least spread^2 m in every direction.
    """
    pick = np.eye(36, 37)
    masses = pick[[9, 19, 29]]
    rows = [-pick[30:36], -masses, masses]
    offset = [np.full(6, -floor / UNIT), np.full(3, -MASSES[0] / UNIT), np.full(3, MASSES[1] / UNIT)]
    cones: list[Any] = [clarabel.NonnegativeConeT(12)]
    inside = PSEUDO_BASIS - margin * np.trace(PSEUDO_BASIS, axis1=1, axis2=2)[:, None, None] * np.eye(4)
    broad = np.array(PSEUDO_BASIS)
    broad[9] -= spread**2 * np.diag([1.0, 1.0, 1.0, 0.0])
    for i in range(3):
        for basis in (inside, broad):
            block = np.zeros((10, 37))  # upper triangle by columns, off-diagonal entries times sqrt(2)
            for row, (k, j) in enumerate(zip(*np.tril_indices(4), strict=True)):
                block[row, 10 * i : 10 * i + 10] = -basis[:, j, k] * (1.0 if j == k else np.sqrt(2.0))
            rows.append(block)
            offset.append(np.zeros(10))
            cones.append(clarabel.PSDTriangleConeT(4))
    return np.concatenate(rows), np.concatenate(offset), cones


@dataclass(frozen=True)
class Derived:
    """The consistent ER-16.

    Attributes:
        bodies: Inertia of each of the six links about its frame.
        friction: Fc and Fv of each of the six joints, shape (6, 2), in N m and N m s/rad.
        beta: Base parameters of joints 1-3 that follow, shape (21,).
        misfit: e of the module's docstring.
        smallest: Smallest misfit under the same conditions.
    """

    bodies: tuple[Inertia, ...]
    friction: Array
    beta: Array
    misfit: float
    smallest: float


def derive(target: Target) -> Derived:
    """Return the consistent ER-16; its parameters are not rounded yet."""
    _, smallest = closest(target)
    x, misfit = closest(target, limit=(1.0 + SLACK) * smallest)
    bodies = (*(Inertia.from_vector(x[10 * i : 10 * i + 10]) for i in range(3)), *WRIST)
    beta = np.concatenate([target.grouping @ np.concatenate([body.vector for body in bodies]), x[30:]])
    return Derived(bodies, np.concatenate([x[30:].reshape(3, 2), WRIST_FRICTION]), beta, misfit, smallest)


NOTE = """\
Kinematics from Table 1 of "Dynamic Model Identification for 6-DOF Industrial Robots". Links 1-3 and the friction of
joints 1-3 are a physically consistent set that comes close to the torques of its Table 2, which no possible robot has;
scripts/derive_er16.py derives it and says how. Table 2 asks for mass far outside any housing, and so these links have
it: a stand-in for torques, not a model of the hardware. Links 4-6, all limits, all drives and the friction of joints
4-6 are our assumption, no maker's data. Rotor inertias are not published; joints 1-3 have 0, because the article
takes the torque of the rotors off before it identifies, so that Table 2 holds none of it."""


def as_yaml(derived: Derived) -> str:
    """Return the text of er16.yaml, numbers rounded to six digits."""
    angles = {np.pi: "pi", np.pi / 2: "pi/2", -np.pi / 2: "-pi/2", 0.0: "0"}
    lines = ["# Written by scripts/derive_er16.py; change that script, not this file.", "name: er16"]
    lines += ["convention: modified", "gravity: [0, 0, -9.81]", "note: >-"]
    lines += [f"  {line}" for line in NOTE.splitlines()] + ["joints:"]
    for i, (alpha, a, d, theta) in enumerate(article.TABLE_1):
        lower, upper, velocity, acceleration, jerk, effort, rate = (_text(value) for value in LIMITS[i])
        gear, rotor, gain = (_text(value) for value in DRIVES[i])
        body = derived.bodies[i]
        moments = body.about_centre[np.triu_indices(3)]
        lines += [
            f"  - name: joint{i + 1}",
            f"    alpha: {angles[alpha]}",
            f"    a: {_text(a)}",
            f"    d: {_text(d)}",
            f"    theta: {angles[theta]}",
            "    # Limits and drive: our assumption.",
            f"    limits: {{lower: {lower}, upper: {upper}, velocity: {velocity}, acceleration: {acceleration},",
            f"      jerk: {jerk}, effort: {effort}, effort_rate: {rate}}}",
            f"    drive: {{gear_ratio: {gear}, rotor_inertia: {rotor}, gain: {gain}}}",
            f"    friction: {_text(derived.friction[i, 0])}" + ("  # our assumption" if i > 2 else ""),
            f"    damping: {_text(derived.friction[i, 1])}" + ("  # our assumption" if i > 2 else ""),
            "    link:",
            f"      name: link{i + 1}",
            "      inertia:" + ("  # our assumption" if i > 2 else ""),
            f"        mass: {_text(body.mass)}",
            f"        centre_of_mass: [{', '.join(_text(v) for v in body.centre_of_mass)}]",
            f"        about_centre: [{', '.join(_text(v) for v in moments)}]",
        ]
    return "\n".join(lines) + "\n"


def _text(value: float) -> str:
    """Return a number with six digits; what is rounding alone is 0."""
    return f"{value:.6g}" if abs(value) >= 1e-6 else "0"


def main() -> None:
    """Rewrite er16.yaml and print what was reached."""
    target = article_target()
    derived = derive(target)
    write_atomically(TARGET, as_yaml(derived))
    print(f"wrote {TARGET.name}; misfit {derived.misfit:.4f}, smallest possible {derived.smallest:.4f}")
    for what, values in (
        ("difference / deviation", target.shares(derived.beta)),
        ("correlation", target.correlations(derived.beta)),
    ):
        print(f"  joints 1-3, {what}: " + "  ".join(f"{v:.3f}" for v in values))
    for i, body in enumerate(derived.bodies):
        eigenvalues = np.linalg.eigvalsh(body.pseudo)
        spread = np.sqrt(
            np.linalg.eigvalsh(0.5 * np.trace(body.about_centre) * np.eye(3) - body.about_centre) / body.mass
        )
        print(
            f"  link{i + 1}: {body.mass:8.3f} kg, spread {np.round(spread, 3)} m, "
            f"smallest eigenvalue {eigenvalues[0] / eigenvalues.sum():.5f} of the trace"
        )


if __name__ == "__main__":
    main()
