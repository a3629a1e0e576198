"""Bodies that are free beside the drives: plausible ones, by the roll-outs of all joints together.

Roll-outs follow the torque of the bodies to first order, and that is linear in the standard parameters theta. With the
free parameters p of all drives minimised over, what is left are convex programs in theta alone, each linearised at the
answer of the last one,

minimise    |e + A (K theta / s - beta) + a (s - 1)|^2 / 2 + |L (theta / t - theta_0)|^2 / 2 + (t - 1)^2 / 2 d^2

within plausible bounds. e, A: the roll-outs' errors and their derivatives by the base parameters beta = K theta, less
what p explains, joint by joint in units of their own standard deviation (that of clustered scores). s, t: the size of
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

from dynident.actuators.arm_coupling import Arm, Response
from dynident.actuators.arm_fit import finer, turned
from dynident.actuators.free_bodies import DEVIATION, FreeBodies, with_bodies
from dynident.actuators.joint_load import carrying, rigid_inertia
from dynident.actuators.parameters import PLACE, SCALE_POWER, with_zero
from dynident.actuators.servo_log import ServoLog, ServoSetup
from dynident.actuators.verdict import pieces_of
from dynident.arrays import Array
from dynident.errors import NotConsistent
from dynident.identification.consistency.conditions import conditions_of
from dynident.identification.consistency.consistent_fit import MARGIN, data_shares, solve_program
from dynident.identification.consistency.labels import label_word
from dynident.identification.consistency.plausible_fit import fitting_bodies, nominal_bodies
from dynident.identification.consistency.program import Program, whitened_rows
from dynident.identification.problem.prior import natural_scale
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.body_constraints import Constraints
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import Inertia
from dynident.model.kernels import batched
from dynident.model.plausible import plausible_constraints, uniform_body
from dynident.model.reduction import triangle_of
from dynident.model.robot import Robot

#: Steps of the bodies at most, turns of the arm after each, and the share of its standard deviation by which no base
#: parameter moves at the last.
STEPS, MORE_TURNS, SETTLED = 12, 1, 0.2

#: What the steps of the answer make of the scale, as a share, where a payload tells it: by virtual arms of three joints
#: that are integrated by steps of 0.01 ms.
INEXACT = 3e-4

#: Programs of a step at most, and the distance in standard deviations that the last of them goes.
_PROGRAMS, _NEAR = 20, 0.05

#: Change of a base parameter by which derivatives are found, as a share of the torque of the bodies. Larger ones move
#: reversals and saturation from step to step: what bodies and drives share would seem to be known.
_CHANGE = 1e-6

#: Change of the zero of an encoder by which derivatives are found, in rad.
_TURN = 1e-3

#: Squared singular values below this share of the largest are directions that the errors of a joint do not see.
_UNSEEN = 1e-8


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
    while True:
        turn += 1
        progress(f"bodies of all links, step {turn}{' with the step of the answer' if finely else ''}")
        seen = finer(arm) if finely else arm
        said = _said(seen, prior, theta, finely)
        found, base = prior.solved(said), prior.base.from_standard(theta)
        moved, rest = prior.base.from_standard(found.theta) - base, found.of_base(prior.base, found.scale)
        is_settled = np.all(np.abs(moved) <= SETTLED * np.sqrt(np.diag(found.of_base(prior.base))))
        theta = found.theta
        at = with_bodies(robot, theta.reshape(-1, 10))
        step = seen.fitted - seen.moved_by + said.offset + said.answer(base + moved)
        arm = replace(arm, robots=[carrying(at, log) for log in logs], used=seen.used)
        arm = turned(arm, arm.after(step), finely)
        if finely:
            return replace(arm, shared=said.drives @ rest @ said.drives.T, scale=found.scale), prior.bodies(found)
        for _ in range(MORE_TURNS):
            arm = arm.coupled(arm.spreads(), is_whole=False)
            arm = turned(arm, arm.after(arm.step()))
        finely = bool(is_settled) or turn == STEPS


@dataclass(frozen=True)
class _Said:
    """What the roll-outs of all joints say of a change of the base parameters beta, shape (b,).

    Attributes:
        rows: In standard deviations of the errors, shape (r, b).
        errors: The same of the errors as they are, shape (r,).
        theta: The bodies, shape (10 l,).
        base: Their base parameters, shape (b,).
        along: How large others are beside them is ``along @ beta``, shape (b,).
        drives: What the P free parameters of all joints answer to a change, shape (P, b).
        offset: What they answer to the errors, shape (P,).
        pieces: Number of pieces of logs that count as independent.
    """

    rows: Array
    errors: Array
    theta: Array
    base: Array
    along: Array
    drives: Array
    offset: Array
    pieces: int

    def answer(self, beta: Array) -> Array:
        """Return what the free parameters answer to base parameters, shape (P,)."""
        size = float(self.along @ beta)
        return np.asarray(self.drives @ (beta / size - self.base + (size - 1.0) * self.base))


def _said(arm: Arm, prior: _Prior, theta: Array, finely: bool) -> _Said:
    """Return what the roll-outs say of the base parameters, from the torque of the bodies theta, shape (10 l,).

    The zero of an encoder turns all bodies behind it: zeros are found from the errors of all joints together.
    """
    columns = [
        np.dstack([regressor[:, :, prior.base.independent], regressor @ (rigid_inertia(robot) - theta)])
        for robot, regressor in zip(arm.robots, _regressors(arm), strict=False)
    ]
    zeros = 0
    for joint, (fit, used) in enumerate(zip(arm.fits, arm.used, strict=True)):
        if "angle_offset" in fit.free:
            zero, zeros = float(used[PLACE["angle_offset"]]), zeros + 1
            after, before = (arm.torques(joint, with_zero(used, zero + by), is_whole=False) for by in (_TURN, -_TURN))
            turn = [(one - other) / (2.0 * _TURN) for one, other in zip(after, before, strict=True)]
            columns = [np.dstack([own, each]) for own, each in zip(columns, turn, strict=True)]
    beta, each, spreads = prior.base.from_standard(theta), [], arm.spreads(finely)
    count, size = len(beta), prior.along_base / (prior.along_base @ beta)
    scale, along = np.append(beta, 1.0), np.append(size, np.zeros(zeros + 2))
    for joint, ((one, fit), spread) in enumerate(zip(arm.pairs(), spreads, strict=True)):
        inner = spread.inner & (np.array(one.free) != "angle_offset")
        response = Response(one.finely if finely else one, fit, replace(spread, inner=inner, seen=np.ones_like(inner)))
        rows, answers = _of_joint(response, [own[:, joint] for own in columns], beta)
        own = np.where(inner, SCALE_POWER[one.places] * fit.parameters[one.places], 0.0)
        # bodies, what is carried and all torques of one scale move alike; what is left of that is an error of columns
        rows = _without(rows, rows[:, : count + 1] @ scale)
        each.append((rows, answers + np.outer(own - answers[:, : count + 1] @ scale, along)))
    rows, answers = (np.concatenate(parts) for parts in zip(*each, strict=True))
    whole, turns, errors = slice(count), slice(count + 1, count + 1 + zeros), -1
    first = triangle_of(np.column_stack([rows[:, turns], rows[:, whole], rows[:, errors]]))
    lead, rest = first[:zeros], first[zeros:]
    of_zeros = -np.linalg.solve(lead[:, :zeros], lead[:, zeros:])
    drives = np.column_stack([answers[:, whole], answers[:, errors]]) + answers[:, turns] @ of_zeros
    drives[arm.zeros] = of_zeros
    rows, pieces = rest[:, zeros:-1], sum(one.pieces for one in spreads)
    return _Said(rows, rest[:, -1], theta, beta, size, drives[:, :-1], drives[:, -1], pieces)


def _of_joint(response: Response, columns: Sequence[Array], beta: Array) -> tuple[Array, Array]:
    """Return rows of a joint and what its free parameters answer, from its torque by c numbers in each log, (K, c).

    Both have the errors in their last column, shapes (r, c + 1) and (f, c + 1); the first b of the c numbers are beta.
    """
    rms = float(np.sqrt(np.mean(np.concatenate([own[:, : len(beta)] @ beta for own in columns]) ** 2)))
    sizes = np.sqrt(np.mean(np.concatenate(columns) ** 2, axis=0))
    moves = np.flatnonzero(sizes * max(float(np.abs(beta).max()), 1.0) > 1e-9 * rms)
    changes = []
    for k in moves.tolist():
        size = _CHANGE * rms / sizes[k]
        changes.append([change / size for change in response.changes([size * own[:, k] for own in columns])])
    slopes, errors, answer = response.less_own([np.column_stack(own) for own in zip(*changes, strict=True)])
    rows = np.concatenate(slopes)
    values, vectors = np.linalg.eigh(rows.T @ rows)
    seen = values > _UNSEEN * values[-1]
    scores = np.array(
        [
            slope[piece].T @ error[piece]
            for slope, error, count in zip(slopes, errors, pieces_of(response.problem.records), strict=True)
            for piece in np.array_split(np.arange(len(error)), count)
        ]
    )
    squares = np.sum((scores @ (vectors[:, seen] / np.sqrt(values[seen]))) ** 2)
    unit = np.sqrt(squares / seen.sum() * len(scores) / max(len(scores) - 1, 1))
    triangle = triangle_of(np.column_stack([rows, np.concatenate(errors)]))[: len(moves)] / unit
    places = [*moves.tolist(), len(sizes)]
    found = np.zeros((len(triangle), len(sizes) + 1)), np.zeros((len(answer), len(sizes) + 1))
    found[0][:, places], found[1][:, places] = triangle, answer
    return found


def _without(rows: Array, direction: Array) -> Array:
    """Return rows (r, c) less what of each column is along a direction of them, (r,)."""
    square = float(direction @ direction)
    return rows - np.outer(direction, direction @ rows) / square if square > 0 else rows


@dataclass(frozen=True)
class _Solved:
    """The bodies that the roll-outs ask for.

    Attributes:
        theta: Shape (10 l,).
        covariance: Shape (10 l, 10 l).
        scale: Standard deviation of a size that all of them have in common, as a share.
        program: Of the last step.
        phi: Its answer.
    """

    theta: Array
    covariance: Array
    scale: float
    program: Program
    phi: Array

    def of_base(self, base: BaseParameters, scale: float = 0.0) -> Array:
        """Return the covariance of the base parameters without that of a common size, shape (b, b)."""
        covariance = self.covariance - scale**2 * np.outer(self.theta, self.theta)
        return np.asarray(base.matrix @ covariance @ base.matrix.T)


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
        rows = np.linalg.inv(whitened_rows(np.linalg.cholesky([_ball(one) for one in self.nominal]), size))
        links = np.zeros((size, len(self.names)))
        links[np.arange(size), np.arange(size) // 10] = own
        spread = DEVIATION**2 * (rows @ rows.T + links @ links.T)
        self.pull = np.linalg.inv(np.linalg.cholesky(spread))
        self.along_base = _torque_along(arm, self.base, own)
        self.along = self.base.matrix.T @ self.along_base
        self.scale = float(np.sqrt(DEVIATION**2 + self.along @ spread @ self.along))

    def solved(self, said: _Said) -> _Solved:
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
        root = np.linalg.inv(triangle_of(curved)) * self.sizes[:, None]
        covariance = root @ root.T + INEXACT**2 * np.outer(theta, theta)
        scale = float(np.hypot(1.0 / np.linalg.norm(curved @ phi), INEXACT))
        return _Solved(theta, covariance, scale, program, phi)

    def bodies(self, found: _Solved) -> FreeBodies:
        """Return the bodies with how far they are known."""
        shares, verdicts = data_shares(found.program, found.phi), self.base.verdicts
        words = [label_word(*each) for each in zip(verdicts, shares.tolist(), strict=True)]
        return FreeBodies(
            self.names,
            self.nominal,
            found.theta.reshape(-1, 10),
            np.sqrt(np.diag(found.covariance)).reshape(-1, 10),
            tuple(tuple(words[10 * k : 10 * k + 10]) for k in range(len(self.names))),
            found.scale,
            bool(found.scale < np.sqrt(0.5) * self.scale),
        )


def _regressors(arm: Arm) -> list[Array]:
    """Return the regressor of the standard parameters in each training log, shape (K, n, 10 l)."""
    return [
        batched.torque_regressor(robot.chain, motion.q, motion.dq, motion.ddq)
        for robot, motion, _ in zip(arm.robots, arm.motions, arm.datas[0].train, strict=False)
    ]


def _torque_along(arm: Arm, base: BaseParameters, theta: Array) -> Array:
    """Return u by which base parameters ask for u @ beta of the torque of bodies theta (10 l,) in the logs, shape (b,).

    That is the projection on this torque; each joint counts alike.
    """
    beta, square = base.from_standard(theta), np.zeros((base.count, base.count))
    rows = [regressor[:, :, base.independent] for regressor in _regressors(arm)]
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
