"""Scales of several torques at once: rated torques, gains or gear ratios of some of the drives.

One joint's scale is that of :mod:`.torque_scales`; where several are off, none of them alone explains the log. The log
variances of all joints in their own scales are lowered by a pattern search (Hooke and Jeeves 1961), from the torques as
they are and from the sizes that the robot model's masses ask for. A common factor is open: most joints keep theirs.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynident.arrays import Array
from dynident.case.evidence.torques import EXPLAINED, scale_against
from dynident.diagnosis.causes.column_readings import GAIN, GOOD, Interpretation
from dynident.diagnosis.causes.held_out import ReadRows
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.torque_scales import FACTOR, PRECISION

#: First step of the search in logarithms, and its most steps.
STEP, STEPS = 1.0, 200

#: Share of a torque below which what friction leaves of it is rounding, and difference of two correlations with the
#: bodies below which these speak for both.
LITTLE, ALIKE = 1e-6, 0.05


def several_scales(fit: QuickFit) -> Interpretation | None:
    """Return the log with the torques of two joints or more in other scales; None where that does not explain it."""
    count = fit.model.robot.dof
    found = min((_lowered(fit, start) for start in _starts(fit)), key=lambda x: float(_scores(fit, x[None])[0]))
    scales = _as_few(fit, found)
    moved = np.flatnonzero(np.abs(scales) > np.log(FACTOR))
    before, after = _scores(fit, np.array([np.zeros(count), scales]))
    if len(moved) < 2 or before - after < GAIN:
        return None
    mixing = np.diag(np.exp(scales))
    deviations = np.sqrt(fit.variances(fit.shared, mixing[None])[0])
    sizes = np.array([np.std(torque[mask]) for torque, mask in zip(fit.rows.torque.T, fit.rows.masks.T, strict=True)])
    if np.any((deviations > GOOD * sizes * np.exp(scales))[moved]):
        return None
    joints = tuple(fit.model.robot.joint_names[k] for k in moved)
    factors = ", ".join(f"{factor:.3g}" for factor in np.exp(scales[moved]))
    evidence = f"with their torques multiplied by {factors}, against the other joints',"
    remedy = (
        "check units, gains and gear ratios of these drives: percent of rated torques differ by joint (log: units: "
        "{torque: percent}; drives: {JOINT: {gain: ..., gear_ratio: ...}})"
    )
    numbers = {f"factor {name}": float(np.exp(scales[k])) for name, k in zip(joints, moved, strict=True)}
    reading = ReadRows(fit.rows, mixing)
    return Interpretation(
        "torque scales", joints, float(before - after), evidence, remedy, reading, numbers, len(moved)
    )


def inverted_gains(fit: QuickFit) -> Iterator[Interpretation]:
    """Yield the log with currents over the stated drive gains in place of times them, where that explains it.

    The torques are compared in a common scale of all, which no log tells.
    """
    if fit.conversion is None:
        return
    robot = fit.model.robot
    coupling = np.asarray(robot.coupling).T
    gains = np.diag(np.linalg.solve(coupling, fit.conversion))
    factors = 1.0 / gains**2
    mixing = coupling @ np.diag(factors / np.exp(np.mean(np.log(factors)))) @ np.linalg.inv(coupling)
    plain, variances = fit.variances(fit.shared, np.stack([np.eye(len(gains)), mixing]))
    gain = float(np.log(plain).sum() - np.log(variances).sum())
    turned = fit.rows.torque @ mixing.T
    sizes = np.array([np.std(torque[mask]) for torque, mask in zip(turned.T, fit.rows.masks.T, strict=True)])
    if gain < GAIN or np.any(np.sqrt(variances) > GOOD * sizes):
        return
    evidence = "with the inverses of the drive gains,"
    remedy = "a drive gain is torque over current: state the inverses (drives: {JOINT: {gain: ...}})"
    numbers = {f"factor {name}": float(factor) for name, factor in zip(robot.joint_names, factors, strict=True)}
    yield Interpretation(
        "torque scales", robot.joint_names, gain, evidence, remedy, ReadRows(fit.rows, mixing), numbers
    )


def _scores(fit: QuickFit, scales: Array) -> Array:
    """Return the sums of log variances with torques e^x times as large, each in its own scale; x of shape (m, n)."""
    mixings = np.exp(scales)[:, :, None] * np.eye(scales.shape[1])
    return np.log(fit.variances(fit.shared, mixings)).sum(axis=1) - 2.0 * scales.sum(axis=1)


def nominal_ratios(fit: QuickFit, explained: float = EXPLAINED) -> Array:
    """Return the torque of each joint over that of the robot model's masses, friction taken out of both, shape (n,).

    NaN where that explains less than a share of the torque's variance, or there are no masses.
    """
    count, nominal = fit.model.robot.dof, fit.model.nominal()
    ratios = np.full(count, np.nan)
    if nominal is None:
        return ratios
    beta = fit.base.from_standard(nominal)
    for k, (block, own) in enumerate(zip(fit.rows.blocks, fit.rows.columns, strict=True)):
        mask, is_friction = fit.rows.masks[:, k], fit.base.is_friction[own]
        if not fit.moves[k]:
            continue
        friction = block[mask][:, is_friction]
        pair = np.column_stack([block[mask] @ np.where(is_friction, 0.0, beta[own]), fit.rows.torque[mask, k]])
        left = pair - friction @ np.linalg.lstsq(friction, pair, rcond=None)[0]
        ratio, correlation = scale_against(*left.T)
        ratios[k] = ratio if ratio > 0 and correlation**2 >= explained else np.nan
    return ratios


def nominal_agreement(fit: QuickFit, reading: ReadRows) -> float:
    """Return the mean correlation of torques of a reading with those of the robot model's bodies, 0 without bodies.

    Friction is taken out of both. Of each joint counts the worse of two: with what is constant, and without it.
    """
    nominal, target, found = fit.model.nominal(), reading.target, list[float]()
    beta = np.zeros(fit.base.count) if nominal is None else fit.base.from_standard(nominal)
    for k in np.flatnonzero(fit.moves).tolist():
        mask, own = reading.rows.masks[:, k], reading.rows.columns[k]
        own, block = own[own < fit.base.count], reading.rows.blocks[k][mask][:, own < fit.base.count]
        is_friction = fit.base.is_friction[own]
        pair = np.column_stack([block @ np.where(is_friction, 0.0, beta[own]), target[mask, k]])
        moving = block[:, is_friction & (np.ptp(block, axis=0) > 0.0)]
        both = [moving, np.column_stack([moving, np.ones(len(moving))])]
        left = [pair - each @ np.linalg.lstsq(each, pair, rcond=None)[0] for each in both]
        told = [each for each in left if np.all(np.linalg.norm(each, axis=0) > LITTLE * np.linalg.norm(pair, axis=0))]
        if told and pair.any(axis=0).all():
            found.append(min(scale_against(*each.T)[1] for each in told))
    return float(np.mean(found)) if found else 0.0


def _starts(fit: QuickFit) -> list[Array]:
    """Return where the search begins: at the torques as they are, and at sizes like those of the robot model."""
    ratios = nominal_ratios(fit)
    known, plain = np.isfinite(ratios), np.zeros(len(ratios))
    if known.sum() < 2:
        return [plain]
    return [plain, np.where(known, -np.log(np.where(known, ratios, 1.0)), -np.median(np.log(ratios[known])))]


def _lowered(fit: QuickFit, start: Array) -> Array:
    """Return the logarithms of the scales near a start whose score no step in one of them lowers, shape (n,)."""
    best, step = start.copy(), STEP
    least = float(_scores(fit, best[None])[0])
    for _ in range(STEPS):
        trials = best + step * np.concatenate([np.eye(len(best)), -np.eye(len(best))])
        values = _scores(fit, trials)
        if values.min() < least:
            best, least = trials[int(np.argmin(values))], float(values.min())
        elif step < PRECISION:
            break
        else:
            step /= 2.0
    return best


def _as_few(fit: QuickFit, scales: Array) -> Array:
    """Return scales (n,) with a common factor taken out, that of the joint with which the fewest differ from one."""
    near = np.abs(scales[:, None] - scales) < np.log(FACTOR)
    most = np.flatnonzero(near[int(np.argmax(near.sum(axis=0)))])
    found = [_pruned(fit, scales - scales[k]) for k in most]
    return min(found, key=lambda x: (np.count_nonzero(x), float(_scores(fit, x[None])[0])))


def _pruned(fit: QuickFit, scales: Array) -> Array:
    """Return scales (n,) with those alone that matter, the others one."""
    kept = scales
    for k in np.argsort(np.abs(kept)):
        without = np.where(np.arange(len(kept)) == k, 0.0, kept)
        before, after = _scores(fit, np.array([without, kept]))
        kept = without if before - after < GAIN else kept
    return kept
