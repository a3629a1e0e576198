"""Bodies that are free beside the drives: plausible ones, by the roll-outs of all joints together.

Roll-outs follow the torque of the bodies to first order, and that is linear in the standard parameters theta. With the
free parameters p of all drives minimised over, what is left are convex programs in theta alone, each linearised at the
answer of the last one,

minimise    |e + A (K theta / s - beta) + a (s - 1)|^2 / 2 + |L (theta / t - theta_0)|^2 / 2 + (t - 1)^2 / 2 d^2

within plausible bounds. e, A: the roll-outs' errors and their derivatives by the base parameters beta = K theta, less
what p explains, joint by joint in units of their own standard deviation (that of what the best bodies leave: misfit of
bodies that are still wrong is no noise). Covariances hold how errors correlate (score_covariance). s, t: the size of
theta beside the bodies that the motions are by and beside those of the robot model, theta_0. Bodies, torques and
friction of one scale move alike: a is what a change of that scale does, 0 where nothing known is carried. Then the
scale is that of the robot model, and its standard deviation d is part of all intervals.

L' L is the inverse of the covariance that is assumed of the robot model: a share DEVIATION of each link as a whole, and
of each entry of its pseudo-inertia beside that of a ball of its mass and largest second moment. d holds a share
DEVIATION of all links together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.actuators.arm_coupling import Arm
from dynident.actuators.arm_fit import finer, turned
from dynident.actuators.body_rows import BodyRows, body_rows, regressors_of
from dynident.actuators.free_bodies import DEVIATION, FreeBodies, with_bodies
from dynident.actuators.joint_load import carrying, rigid_inertia
from dynident.actuators.servo_log import ServoLog, ServoSetup
from dynident.arrays import Array
from dynident.errors import NotConsistent
from dynident.identification.consistency.conditions import IDENTITY_VECTOR, Conditions, conditions_of
from dynident.identification.consistency.consistent_fit import ACTIVE, MARGIN, data_shares, solve_program
from dynident.identification.consistency.labels import label_word
from dynident.identification.consistency.plausible_fit import fitting_bodies, nominal_bodies
from dynident.identification.consistency.program import Program, whitened_rows
from dynident.identification.problem.prior import natural_scale
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.body_constraints import Constraints
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import Inertia
from dynident.model.plausible import plausible_constraints, uniform_body
from dynident.model.reduction import triangle_of
from dynident.model.robot import Robot

#: Steps of the bodies at most, turns of the arm after each, and the share of its standard deviation by which no base
#: parameter moves at the last.
STEPS, MORE_TURNS, SETTLED = 12, 1, 0.2

#: Rise of the mean logarithm of the errors from which half a step is tried, and the share of a step that ends it.
_RISE, _LEAST_STEP = 0.02, 0.2

#: Programs of a step at most, and the distance in standard deviations that the last of them goes.
_PROGRAMS, _NEAR = 20, 0.05


def free_bodies(
    arm: Arm, robot: Robot, setup: ServoSetup, logs: Sequence[ServoLog], progress: Callable[[str], None]
) -> tuple[Arm, FreeBodies]:
    """Return an arm with the bodies that its roll-outs ask for, and the fits of its joints under their load.

    Args:
        arm: Settled under the bodies of the robot model.
        robot: Without payloads.
        setup: Which bodies may be found, and what is known about them.
        logs: The logs of the arm, with what it carried.
        progress: Called with each step in words.

    Raises:
        NotConsistent: A link of the robot model states no inertia that a body has.
        ContradictoryConstraints: No robot meets the bounds.
    """
    prior, turn, finely = _Prior(robot, setup, arm), 0, False
    theta = rigid_inertia(robot)
    arm = replace(arm, turns=())  # they were under other bodies
    if len(arm.fits) == 1:  # it has been on its measured motion so far
        arm = turned(arm, arm.fits)
    while True:
        turn += 1
        progress(f"bodies of all links, step {turn}{' with the step of the answer' if finely else ''}")
        seen = finer(arm) if finely else arm
        said = body_rows(seen, prior.base, prior.along_base, theta, finely)
        found, base = prior.solved(said), prior.base.from_standard(theta)
        covariance, before, share, moved = found.of_base(prior.base), arm.error(), 1.0, found.theta - theta
        while True:
            to = prior.base.from_standard(theta + share * moved)
            step = seen.fitted - seen.moved_by + share * said.offset + said.answer(to)
            at = with_bodies(robot, (theta + share * moved).reshape(-1, 10))
            tried = replace(arm, robots=[carrying(at, log) for log in logs], used=seen.used)
            tried = turned(tried, tried.after(step), finely)
            if finely or share < _LEAST_STEP or tried.error() < before + _RISE:
                break
            share *= 0.5
        arm, theta = tried, theta + share * moved
        if finely:
            known = _best_known(to, covariance)
            slopes = said.drives, said.drives - np.outer(said.powers, known)
            shared = np.array([each @ covariance @ each.T for each in slopes])
            return replace(arm, shared=shared), prior.bodies(found, float(np.sqrt(known @ covariance @ known)))
        for _ in range(MORE_TURNS):
            arm = arm.coupled(arm.spreads(), is_whole=False)
            arm = turned(arm, arm.after(arm.step()))
        is_settled = np.all(np.abs(to - base) <= SETTLED * share * np.sqrt(np.diag(covariance)))
        finely = bool(is_settled) or turn == STEPS


@dataclass(frozen=True)
class _Solved:
    """The bodies that the roll-outs ask for.

    Attributes:
        theta: Shape (10 l,).
        covariance: Shape (10 l, 10 l).
        program: Of the last step.
        phi: Its answer.
    """

    theta: Array
    covariance: Array
    program: Program
    phi: Array

    def of_base(self, base: BaseParameters) -> Array:
        """Return the covariance of the base parameters, shape (b, b)."""
        return np.asarray(base.matrix @ self.covariance @ base.matrix.T)


def stated_bodies(robot: Robot, setup: ServoSetup) -> tuple[Array, Array, Constraints]:
    """Return the bodies of a robot model, uniform ones that fill its links, each (l, 10), and the plausible bounds.

    Raises:
        NotConsistent: A link states no inertia that a body has.
    """
    whole = plausible_constraints(robot, setup.constraints)
    filling = np.array([uniform_body(whole.links[link.name]).vector for link in robot.links])
    bodies, _, without = nominal_bodies(robot, filling, None)
    if without:
        step = "state mass, centre and inertia of every link: what the logs do not determine stays there"
        raise NotConsistent(f"robot '{robot.name}'", f"no possible inertia of {', '.join(without)}", step)
    return bodies, filling, whole


class _Prior:
    """The bodies of a robot model with their bounds, and how far others are from them.

    Attributes:
        base: Base parameters of the robot.
        nominal: The bodies, shape (l, 10).
        along_base: How large others are beside them is ``along_base @ beta`` by their base parameters, shape (b,).
        along: The same of their standard parameters, shape (10 l,).
        scale: Standard deviation of that size.
    """

    def __init__(self, robot: Robot, setup: ServoSetup, arm: Arm) -> None:
        model, still = DynamicModel(robot), np.zeros(robot.dof)
        bodies, filling, whole = stated_bodies(robot, setup)
        self.base, self.names = base_parameters(model), tuple(link.name for link in robot.links)
        sizes = natural_scale(model, still, still)
        bounds, size = whole if setup.bodies == "plausible" else setup.constraints, len(model.parameters)
        rules = conditions_of(model, sizes, MARGIN, bounds)
        self.nominal, self.sizes = fitting_bodies(bodies, filling, rules, sizes)[0], sizes.parameters
        start, none = self.nominal.ravel() / self.sizes, np.zeros((0, size))
        self.program = Program(none, np.zeros(0), none, np.zeros(0), 0.0, np.zeros((0, 4, 4)), rules, start)
        own = self.nominal.ravel()
        twice = np.tile(np.where(IDENTITY_VECTOR > 0.0, 1.0, np.sqrt(0.5)), len(self.names))  # entries off the diagonal
        balls = np.linalg.cholesky([_ball(one) for one in self.nominal])
        rows = np.linalg.inv(twice[:, None] * whitened_rows(balls, size))
        links = np.zeros((size, len(self.names)))
        links[np.arange(size), np.arange(size) // 10] = own
        spread = DEVIATION**2 * (rows @ rows.T + links @ links.T)
        self.pull = np.linalg.inv(np.linalg.cholesky(spread))
        self.along_base = _torque_along(arm, self.base, own)
        self.along = self.base.matrix.T @ self.along_base
        self.scale = float(np.sqrt(DEVIATION**2 + self.along @ spread @ self.along))

    def solved(self, said: BodyRows) -> _Solved:
        """Return the bodies that the roll-outs ask for.

        Errors depend on the bodies over their size, but for what is carried; that is linearised in each step.
        """
        unit, theta, by_size = np.sqrt(said.pieces), said.theta, said.rows @ said.base
        program, phi = self.program, self.program.start
        shape, nominal = said.rows - np.outer(by_size, said.along), self.nominal.ravel()
        for _ in range(_PROGRAMS):
            beta = self.base.from_standard(theta)
            size, large = float(said.along @ beta), float(self.along @ theta)
            left = said.errors + shape @ beta / size + (size - 1.0) * by_size
            rows = (shape - np.outer(shape @ beta / size, said.along)) / size + np.outer(by_size, said.along)
            rows = rows @ self.base.matrix
            pull = (self.pull - np.outer(self.pull @ theta / large, self.along)) / large
            pull, aside = np.vstack([pull, self.along / self.scale]), self.pull @ (theta / large - nominal)
            aim = pull @ theta - np.append(aside, (large - 1.0) / self.scale)
            program = replace(
                self.program,
                data=rows * self.sizes / unit,
                target=(rows @ theta - left) / unit,
                pull=pull * self.sizes / unit,
                pull_target=aim / unit,
            )
            phi = solve_program(program).candidate.phi
            step, theta = phi * self.sizes - theta, phi * self.sizes
            if np.linalg.norm(np.vstack([rows, pull]) @ step) < _NEAR:
                break
        curved = unit * program.curvature(phi)
        root = np.linalg.inv(triangle_of(curved))
        gain = root @ root.T @ (unit * program.data).T
        covariance = root @ root.T + gain @ (said.noise - np.eye(len(gain.T))) @ gain.T
        return _Solved(theta, covariance * np.outer(self.sizes, self.sizes), program, phi)

    def bodies(self, found: _Solved, scale: float) -> FreeBodies:
        """Return the bodies with how far they are known, and the standard deviation of the scale of all torques."""
        shares, verdicts = data_shares(found.program, found.phi), self.base.verdicts
        words = [label_word(*each) for each in zip(verdicts, shares.tolist(), strict=True)]
        return FreeBodies(
            self.names,
            self.nominal,
            found.theta.reshape(-1, 10),
            np.sqrt(np.diag(found.covariance)).reshape(-1, 10),
            tuple(tuple(words[10 * k : 10 * k + 10]) for k in range(len(self.names))),
            scale,
            bool(scale < np.sqrt(0.5) * DEVIATION),
            _mass_bounds(found.program.conditions, found.phi),
        )


def _mass_bounds(rules: Conditions, phi: Array) -> tuple[str, ...]:
    """Return the bounds of masses that bodies end at, in words."""
    rows = zip(rules.sign_words, rules.signs(phi), rules.sign_sizes, strict=True)
    return tuple(words for words, slack, (_, unit) in rows if unit == "kg" and slack < ACTIVE)


def _best_known(base: Array, covariance: Array) -> Array:
    """Return w: the scale of all bodies is w @ base, 1 at base parameters (b,), by those whose ratios are known best.

    Their weights are the inverse variances beside the largest part of the covariance that is a common scale; what
    correlates is not weighed up, as that would take derivatives that are exact to the same share.
    """
    sizes = np.sqrt(np.diag(covariance))
    inverse = np.linalg.pinv(covariance / np.outer(sizes, sizes), rcond=1e-12, hermitian=True)
    common = 1.0 / float((base / sizes) @ inverse @ (base / sizes))
    known = base / np.maximum(sizes**2 - common * base**2, 1e-6 * sizes**2)
    return np.asarray(known / (base @ known))


def _torque_along(arm: Arm, base: BaseParameters, theta: Array) -> Array:
    """Return u by which base parameters ask for u @ beta of the torque of bodies theta (10 l,) in the logs, shape (b,).

    That is the projection on this torque; each joint counts alike.
    """
    beta, square = base.from_standard(theta), np.zeros((base.count, base.count))
    rows = [regressor[:, :, base.independent] for regressor in regressors_of(arm)]
    for joint in range(len(arm.datas)):
        own = np.concatenate([each[:, joint] for each in rows])
        square += own.T @ own / max(float(np.sum((own @ beta) ** 2)), 1e-300)
    found = square @ beta
    return np.asarray(found / (beta @ found))


def _ball(body: Array) -> Array:
    """Return the pseudo-inertia of a ball with mass, centre and largest second moment of a body (10,)."""
    pseudo = Inertia.from_vector(body).pseudo
    mass, centre = pseudo[3, 3], pseudo[:3, 3] / pseudo[3, 3]
    most = float(np.linalg.eigvalsh(pseudo[:3, :3] - mass * np.outer(centre, centre))[-1])
    found = mass * np.outer(np.append(centre, 1.0), np.append(centre, 1.0))
    found[:3, :3] += most * np.eye(3)
    return found
