"""Whether the torques follow the equations of the robot model at all, or those of another robot.

The bodies are shared by all joints. Where lengths or axes are those of the robot, parameters of each joint's own
predict unseen samples no better than the shared ones; where they are another's, far better, and much torque is left.
Held out as in :mod:`.held_out`. The parameters of a joint alone are drawn to the shared ones by a ridge (Hoerl and
Kennard 1970), as few rows tell them apart.

Where little torque is left in all, one joint may be predicted little better than by a constant, or worse. So is a
torque that is mostly noise: what the model has to explain is told by a regression on the motion alone, without a robot,
held out in long stretches, between which noise that hangs together is not interpolated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.causes.cause_search import Blame, Cause
from dynident.diagnosis.causes.held_out import HeldOutErrors, ReadRows, as_stated, judged
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.finding import LOST
from dynident.identification.problem.regressor_stream import motion_of
from dynident.model.friction import Motion
from dynident.model.friction.presliding import Presliding

#: Ridges that are tried, as shares of the squares of a joint's column: many parameters need a strong one.
RIDGES = (1e-2, 1e-1, 1.0)

#: Share of the torque that is left, gain of parameters of each joint's own in log variance, and standard errors of it,
#: from which the torques are surely another robot's; share left from which they are suspected to be.
LEFT, GAIN, SURE, SUSPECTED = 0.1, 1.0, 3.0, 0.25

#: Share of what is left, root mean squares, below which known causes explain most of it: half of the variance.
MOST = 0.7

#: Lengths in rad or m over which friction may build up after a reversal (Prandtl and Ishlinskii's stop operators).
LENGTHS = (0.003, 0.01, 0.03, 0.1)

#: Share of the variance that the model or a constant leaves, which a regression on the motion leaves at most where the
#: torque follows the motion, and stretches of the log, each predicted by the regression of the others.
FOLLOWS, STRETCHES = 0.5, 4


@dataclass(frozen=True)
class RobotMisfit:
    """What a robot model leaves of the torques on samples that were not fitted.

    Attributes:
        left: Root mean square of the residual over that of the torque less its mean, all joints together.
        joints: The same of each joint, shape (n,).
        gain: By how much parameters of each joint's own are better, in log variance.
        spread: Standard error of the gain.
        kept: Share of what is left, in squares of all torques, that these parameters leave too.
    """

    left: float
    joints: Array
    gain: float
    spread: float
    kept: float

    @property
    def is_sure(self) -> bool:
        """Whether the equations are those of another robot: parameters of each joint's own then take most of it.

        One joint whose friction or bias the model lacks makes a gain as well, and leaves the rest as it was.
        """
        return self.left > LEFT and self.gain > max(GAIN, SURE * self.spread) and self.kept < MOST**2

    @property
    def is_structured(self) -> bool:
        """Whether parameters of each joint's own predict unseen samples better, however little is left."""
        return self.gain > self.spread

    @property
    def is_suspected(self) -> bool:
        """Whether so much is left that they may be; where all is, the parts of the log do not tell one another."""
        return SUSPECTED < self.left < 1.0


def robot_misfit(fit: QuickFit, reading: ReadRows | None = None, known: Sequence[Cause] = ()) -> RobotMisfit:
    """Return what is left of the torques of a log.

    Args:
        fit: The log.
        reading: How its rows are read; None for as the case states.
        known: Causes of a residual: those that predict unseen samples better are taken in, where so much is left that
            they matter and they explain most of it.
    """
    held = HeldOutErrors(fit)
    reading = reading or as_stated(fit)
    errors, torque, told = held.errors(reading), reading.rows.torque, judged(fit.rows.masks)
    columns = zip(torque.T, reading.rows.masks.T, told, strict=True)
    size = np.array([np.var(column[mask]) if one else 0.0 for column, mask, one in columns])
    counts, shared, plain = np.maximum(reading.rows.masks.sum(axis=0), 1), reading, errors
    for cause in known if _left(errors / counts, size) > LEFT else ():
        taken = _with_cause(shared, cause)
        lower = held.errors(taken)
        if held.difference(lower, errors)[0] > 0.0:
            shared, errors = taken, lower
    if _left(errors / counts, size) > MOST * _left(plain / counts, size):
        shared, errors = reading, plain
    alone = [held.errors(shared, ridge=ridge) for ridge in RIDGES]
    gains = [held.difference(each, errors) for each in alone]
    gain, spread = max(gains, key=lambda each: each[0] / max(GAIN, SURE * each[1]))
    kept = min(float(each.sum()) for each in alone) / max(float(errors.sum()), 1e-300)
    joints = np.sqrt(errors.sum(axis=0) / counts / np.maximum(size, 1e-300))
    return RobotMisfit(_left(errors / counts, size), joints, gain, spread, kept)


def presliding(fit: QuickFit) -> list[Cause]:
    """Return friction that builds up over several lengths after a reversal, of each drive, filtered as the torques are.

    With lengths that are a share of its motion it looks like a spring that turns round with the motion, which bodies of
    each joint's own take in.
    """
    coupling, log, found = np.asarray(fit.model.robot.coupling), fit.rows.prepared.log, list[Cause]()
    motion = Motion(*(np.asarray(getattr(log, name)) @ coupling.T for name in ("q", "dq", "ddq")))
    bent = [Presliding(length=own).states_along(motion, 1.0 / log.rate)[..., 0] / own for own in LENGTHS]
    for j, name in enumerate(fit.model.robot.joint_names):
        smooth = fit.rows.prepared.smooth(np.stack([own[:, j] for own in bent]))[:, fit.rows.prepared.keep]
        found.append(Cause("presliding", name, smooth[:, :, None] * coupling[j], is_filtered=True))
    return found


def held_out_gain(fit: QuickFit, blame: Blame) -> tuple[float, float]:
    """Return by how much a cause predicts unseen samples better, in log variance, and the standard error of it."""
    held = HeldOutErrors(fit)
    return held.difference(held.errors(_with_cause(as_stated(fit), blame.cause)), held.plain)


def _left(shares: Array, size: Array) -> float:
    """Return the root of mean squared errors, by their shares (blocks, n), over torques of variance ``size`` (n,)."""
    return float(np.sqrt(shares.sum() / max(float(size.sum()), 1e-300)))


def _with_cause(reading: ReadRows, cause: Cause) -> ReadRows:
    extra = cause.columns
    size = 1 + max(int(own.max()) for own in reading.rows.columns)
    every = np.arange(size, size + len(extra))
    blocks = tuple(np.column_stack([block, extra[:, :, i].T]) for i, block in enumerate(reading.rows.blocks))
    columns = tuple(np.concatenate([own, every]) for own in reading.rows.columns)
    return replace(reading, rows=replace(reading.rows, blocks=blocks, columns=columns))


def unpredicted(fit: QuickFit, known: Sequence[Blame] = ()) -> dict[int, tuple[float, float]]:
    """Return the joints of whose torque the model explains next to nothing, and a regression on the motion far more.

    Args:
        fit: The log.
        known: Causes of a residual that are told: where these explain the torque, it is not missed.

    Returns:
        Of each joint, by its number, the root mean square of the model's error over that of the constant, and the share
        of the variance about the constant that the regression leaves.
    """
    if not (lost := fit.relative > LOST).any():
        return {}
    held, reading = HeldOutErrors(fit), as_stated(fit)
    errors = held.plain
    for blame in known:  # one that predicts unseen samples worse explains nothing
        taken = _with_cause(reading, blame.cause)
        lower = held.errors(taken)
        if held.difference(lower, errors)[0] > 0.0:
            reading, errors = taken, lower
    motion = motion_of(fit.rows.prepared.kept)
    q, dq, ones = np.asarray(motion.q), np.asarray(motion.dq), np.ones((len(fit.rows.torque), 1))
    by_motion = np.hstack([ones, np.sin(q), np.cos(q), dq, np.sign(dq), np.asarray(motion.ddq)])
    plain = _regression(fit, ones)
    model, constant = errors.sum(axis=0), held.errors(plain).sum(axis=0)
    worst = np.max(model / np.maximum(constant, 1e-300))  # a joint that is not explained spoils others a little
    worse = np.flatnonzero(lost & (model > (1.0 if worst > 1.0 else LOST**2) * constant)).tolist()
    if not worse:
        return {}
    left, whole = (_by_stretches(each) for each in (_regression(fit, by_motion), plain))
    return {
        i: (float(np.sqrt(model[i] / constant[i])), float(left[i] / whole[i]))
        for i in worse
        if left[i] < FOLLOWS * min(model[i] / constant[i], 1.0) * whole[i]
    }


def _regression(fit: QuickFit, columns: Array) -> ReadRows:
    """Return the rows of a regression of each torque on the same columns (N, k), coefficients of each its own."""
    joints, size = len(fit.counts), columns.shape[1]
    own = tuple(np.arange(k * size, (k + 1) * size) for k in range(joints))
    return ReadRows(replace(fit.rows, blocks=(columns,) * joints, columns=own), np.eye(joints))


def _by_stretches(reading: ReadRows) -> Array:
    """Return the sums of squared errors of each torque, stretch by stretch predicted by the others, shape (n,)."""
    masks, found = reading.rows.masks, np.zeros(reading.rows.masks.shape[1])
    stretches = np.arange(len(masks)) * STRETCHES // len(masks)
    for k in range(STRETCHES):
        unseen = (stretches == k)[:, None]
        errors = reading.squared_errors(reading.fitted(masks & ~unseen).beta)
        found += np.where(masks & unseen, errors, 0.0).sum(axis=0)
    return found
