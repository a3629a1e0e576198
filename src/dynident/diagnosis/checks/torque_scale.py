"""Scale of the torques: one joint against the others, and all against the masses of the robot model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from dynident.arrays import Array
from dynident.case.evidence.torques import EXPLAINED, OFF, agrees, scale_against
from dynident.data.motor_side import gears_of
from dynident.diagnosis.causes.column_readings import GAIN, variance_falls
from dynident.diagnosis.causes.known_bodies import KnownBodies
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.several_scales import nominal_ratios
from dynident.diagnosis.causes.signs_of_all import opposite_torques
from dynident.diagnosis.causes.torque_scales import JointScale, mixing_of, other_scales
from dynident.diagnosis.checks._torque_unit import FAR_OFF, OF_UNIT, SURE, UNIT, are_alike, beyond_rotors, other_unit
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import CONSEQUENCES, Finding, Severity, listed
from dynident.identification.problem.regressor_stream import motion_of
from dynident.identification.residuals.quantiles import student_quantile
from dynident.model.friction import Motion

#: Ratio of the largest factor against these masses to the smallest from which the drives have factors of their own.
APART = 1.5

#: Deviation of a weight over its mean below which it is constant, share of it that is held the other way for sure, and
#: speed in m/s over which the sign of friction is smoothed.
CONSTANT, HELD, SLOW = 0.05, 0.5, 0.002

#: Share of the samples that a slide moves each way at least, for its weight to be told from its friction.
BOTH_WAYS = 0.1

#: What torques of the other side of the gears look like besides.
READINGS = ("another robot", "coupling", "torque sign", "torque order", "joint order", "position sign", "axis sign")
OTHER_SIDE = (*CONSEQUENCES, "torque scales", "torque units", "mounting", "torque without gravity", *READINGS)


class Ratio(NamedTuple):
    """Fitted torques over those of known bodies, their correlation, and the half-width of the 95 % interval."""

    ratio: float
    alike: float
    half: float


@dataclass(frozen=True)
class TorqueScale(Check):
    """Gear ratios, gains and units of the torques, and inverted gravity."""

    stage: ClassVar[int] = 2

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        fit = subject.fit
        if fit is None:
            return []
        if side := _other_side(subject, fit):
            return side
        found = other_scales(subject.scales)
        return [
            *_all_joints(fit, found, subject),
            *_one_joint(subject, found),
            *_open_scales(fit, subject.scales),
            *_lifted(fit),
        ]

    @staticmethod
    def tells_unit(subject: CheckedLog) -> bool:
        """Return whether torques are told to be in another unit, of which one scale of all of them is another word."""
        fit = subject.fit
        told = [] if fit is None else _all_joints(fit, other_scales(subject.scales), subject)
        return any(finding.name == UNIT for finding in told)


def _other_side(subject: CheckedLog, fit: QuickFit) -> list[Finding]:
    """Return that torques of motors are read as those of joints, or the reverse, by the stated gears and the masses.

    Gears that are all alike are no other than a unit of all torques, for which another finding stands.
    """
    theta, columns, mixing = fit.model.nominal(), subject.raw.columns, _through_gears(subject, fit)
    if theta is None or mixing is None:
        return []
    ratio, alike, _ = against_nominal(fit, theta, mixing)
    common = mixing / np.exp(np.linalg.slogdet(mixing)[1] / len(mixing))
    before, after = np.log(fit.variances(fit.shared, np.stack([np.eye(len(mixing)), common]))).sum(axis=1)
    if not agrees(ratio) or alike < SURE or before - after < GAIN:
        return []
    was, way, line = "motors", "times", "motor" if "q" in columns.motor else "{torque: motor}"
    if "torque" in columns.motor:
        was, way, line = "joints", "over", "{torque: link}"
    evidence = (
        f"{way} the stated gear ratios, torques are {ratio:.3g} times those of the robot model's masses (correlation "
        f"{alike:.3f}) and {variance_falls(before - after)}: they are those of the {was}"
    )
    remedy = f"state the side of the gears (log: side: {line})"
    return [Finding("error", "torque side", "", evidence, remedy, {"ratio": ratio, "correlation": alike}, OTHER_SIDE)]


def _through_gears(subject: CheckedLog, fit: QuickFit) -> Array | None:
    """Return what turns torques into those of the other side of the gears, shape (n, n); None without gears."""
    robot = fit.model.robot
    gears = gears_of(robot).T
    if fit.conversion is not None or np.allclose(gears, np.eye(robot.dof)):
        return None
    return np.linalg.inv(gears) if "torque" in subject.raw.columns.motor else gears


def _one_joint(subject: CheckedLog, found: Sequence[JointScale]) -> list[Finding]:
    """Return the joint whose torque fits the others best with another scale, and those that explain it as well."""
    if not found or subject.stretched is not None:  # its positions are in another scale
        return []
    best = found[0]
    evidence = f"with its torque multiplied by {_interval(best)}, {variance_falls(best.gain)}"
    if found[1:]:
        others = " or ".join(f"{rival.joint}'s by {_interval(rival)}" for rival in found[1:])
        evidence += f"; multiplying {others} explains the log about as well: not separable"
    remedy = "check gear ratio, gain and unit, and the kinematic coupling of the drives (coupling)"
    numbers = {"factor": best.factor, "low": best.low, "high": best.high, "gain": best.gain}
    sure = best is subject.sure_scale
    severity: Severity = "error" if sure else "warning"
    explains = (*(name for name in CONSEQUENCES if name != "torque scale"), "link frame") if sure else ()
    joints = listed([each.joint for each in found])
    return [Finding(severity, "torque scale", joints, evidence, remedy, numbers, explains)]


def _interval(scale: JointScale) -> str:
    """Return the factor with its interval, in digits that tell the ends apart; the interval alone where it is wide."""
    if scale.is_open:
        return f"{scale.low:.3g} to {scale.high:.3g} (95 %)" if np.isfinite(scale.high) else f"{scale.low:.3g} or more"
    for digits in (3, 4, 5):
        low, high = (f"{end:.{digits}g}" for end in (scale.low, scale.high))
        if low != high:
            break
    return f"{scale.factor:.{digits}g} ({low} to {high}, 95 %)"


def _open_scales(fit: QuickFit, scales: Sequence[JointScale]) -> list[Finding]:
    """Return which torques may have any scale as far as the log goes."""
    unknown = [scale.joint for scale in scales if scale.is_open]
    if not unknown:
        return []
    decides = (
        "the masses of the robot model decide it" if fit.model.nominal() is not None else "nothing else decides it"
    )
    evidence = "the scale of these torques cannot be determined from these samples (95 % interval wider than +- 25 %)"
    remedy = f"compare gear ratios and gains with the data sheet; {decides}"
    return [Finding("note", "scale not determined", listed(unknown), evidence, remedy, {"joints": float(len(unknown))})]


def _all_joints(fit: QuickFit, found: Sequence[JointScale], subject: CheckedLog) -> list[Finding]:
    """Return what known bodies say of all torques, that of a joint with another scale in its own.

    Those of an earlier estimate go before the masses of the robot model, which may have none. No unit is told where a
    load explains the difference.
    """
    mixing, known = mixing_of(fit, found[0]) if found else None, subject.known
    is_loaded = subject.against_earlier is not None and subject.against_earlier.is_loaded
    if known is not None and not is_loaded:
        against = against_known(fit, known, mixing)
        if told := _other_unit(against, "the earlier estimate", other_unit(fit, against.ratio)):
            return told
    theta = fit.model.nominal()
    if theta is None:
        return []
    against = against_nominal(fit, theta, mixing)
    if (told := opposite_torques(fit)) or is_loaded:
        return told
    ratios = nominal_ratios(fit, SURE**2)
    other = other_unit(fit, against.ratio)
    return _other_units(fit, ratios) or _other_unit(against, "the robot model", other, are_alike(fit, ratios))


def _other_units(fit: QuickFit, ratios: Array) -> list[Finding]:
    """Return that the torques are far off those of the robot model's masses, each by a factor of its own, (n,)."""
    told = np.flatnonzero(np.isfinite(ratios))
    logs, gains = np.log(ratios[told]), [joint.drive.gain for joint in fit.model.robot.active]
    is_filled = fit.effort != "torque" and all(gain == 1.0 for gain in gains)
    beyond = OFF if is_filled else FAR_OFF  # no drive has a gain of one, and not all of them
    if len(told) < max(2, fit.moves.sum() / 2) or not abs(np.median(logs)) > np.log(beyond):
        return []
    if not np.all(np.sign(np.median(logs)) * logs > np.log(OFF)) or np.ptp(logs) < np.log(APART):
        return []
    names = [fit.model.robot.joint_names[k] for k in told]
    each = ", ".join(f"{1 / ratio:.3g} ({name})" for ratio, name in zip(ratios[told], names, strict=True))
    evidence = f"the robot model's masses ask for {each} times the measured torques"
    remedy = (
        "torques of the motors before their gears, or rated torques of the motors in place of the joints'? state gains "
        "and gear ratios (drives: {JOINT: {gain: ..., gear_ratio: ...}}; log: side: {torque: motor}), or rated torques "
        "at the joints (log: rated)"
    )
    if is_filled:
        evidence = f"all drive gains are stated as 1, and {evidence}"
        remedy = (
            "state the gains, gear ratio times torque constant (drives: {JOINT: {gain: ...}}), from data sheets, or "
            "find them with dynident gains"
        )
    numbers = {f"ratio {name}": float(ratio) for name, ratio in zip(names, ratios[told], strict=True)}
    explains = (*CONSEQUENCES, "torque scales", "another robot", "coupling", "link frame")
    return [Finding("error", "torque units", listed(names), evidence, remedy, numbers, explains)]


def _lifted(fit: QuickFit) -> list[Finding]:
    """Return slides that carry a constant weight by the robot model, and hold it the other way by the log.

    An offset of the friction takes such a weight in, so that no fit shows it.
    """
    theta = fit.model.nominal()
    if theta is None:
        return []
    bodies = _without_friction(fit, theta)
    motion = motion_of(fit.rows.prepared.kept)
    still = Motion(motion.q, np.zeros_like(motion.q), np.zeros_like(motion.q))
    weight = fit.model.torque(still, bodies) - fit.model.known_torque(still)
    moved = fit.model.torque(motion, bodies) - fit.model.known_torque(motion) - weight
    found = []
    for k, joint in enumerate(fit.model.robot.active):
        mask, mean = fit.rows.masks[:, k], float(weight[:, k].mean())
        if joint.kind != "prismatic" or not fit.moves[k] or not np.std(weight[:, k]) < CONSTANT * abs(mean):
            continue
        speed = motion.dq[:, k]
        if min(np.mean(speed[mask] > SLOW), np.mean(speed[mask] < -SLOW)) < BOTH_WAYS:
            continue  # friction of one way is no other than a weight
        columns = np.column_stack([np.ones(len(speed)), np.tanh(speed / SLOW), speed, motion.ddq[:, k], moved[:, k]])
        columns, target = columns[mask], (fit.rows.torque - fit.rows.known)[mask, k]
        fitted = np.linalg.lstsq(columns, target, rcond=None)[0]
        held, left = float(fitted[0]), float(np.std(target - columns @ fitted))
        if HELD * abs(mean) < -held * np.sign(mean) and left < abs(mean):
            evidence = f"it holds {held:.4g} N on average where the robot model's masses weigh {mean:.4g} N"
            stated = float(fit.model.robot.bias[k])
            carried = f"drives: {{{joint.name}: {{bias: {stated + mean - held:.4g}}}}}"
            remedy = (
                "turn the signs of its position and torque if it counts the other way; check the direction of gravity; "
                f"where something else carries weight, state that force along its axis ({carried}, now {stated:.4g})"
            )
            numbers = {"held": held, "weight": mean}
            found.append(Finding("error", "axis sign", joint.name, evidence, remedy, numbers))
    return found


def _other_unit(against: Ratio, whose: str, remedy: str, are_alike: bool = False) -> list[Finding]:
    """Return that torques are in another unit than those of known bodies, where their ratio and correlation say so."""
    ratio, alike, half = against
    if alike < 0 or alike**2 < EXPLAINED or agrees(ratio):
        return []
    interval = f" (+- {half:.2g})" if np.isfinite(half) else ""
    evidence = f"the torques are {ratio:.3g}{interval} times those that {whose} predicts (correlation {alike:.3f})"
    numbers = {"ratio": ratio, "half_width": half, "correlation": alike}
    if alike > SURE and (are_alike or not 1 / FAR_OFF < ratio < FAR_OFF):
        return [Finding("error", UNIT, "", evidence, remedy, numbers, OF_UNIT)]
    return [Finding("warning", UNIT, "", evidence, remedy, numbers)]


def against_known(fit: QuickFit, known: KnownBodies, mixing: Array | None) -> Ratio:
    """Return scale and correlation of the bodies' torque, fitted to mixing @ torque, against an earlier estimate's."""
    stated = np.zeros(fit.base.count)
    stated[known.places] = known.values
    fitted = np.zeros(fit.base.count)
    fitted[known.places] = fit.solve(fit.triangles.products, mixing).beta[known.places]
    pairs = [
        (block @ stated[own], block @ fitted[own]) for block, own in zip(fit.rows.blocks, fit.rows.columns, strict=True)
    ]
    theirs, ours = (np.stack(each, axis=1) for each in zip(*pairs, strict=True))
    return _ratio(theirs - theirs.mean(axis=0), ours - ours.mean(axis=0))


def against_nominal(fit: QuickFit, theta: Array, mixing: Array | None) -> Ratio:
    """Return scale and correlation of the bodies' torque, fitted to mixing @ torque, against the robot model's."""
    beta = fit.solve(fit.triangles.products, mixing).beta
    nominal = fit.model.torque(motion_of(fit.rows.prepared.kept), _without_friction(fit, theta))
    fitted = np.stack(
        [
            block[:, inertial] @ beta[own][inertial]
            for block, own in zip(fit.rows.blocks, fit.rows.columns, strict=True)
            for inertial in [fit.base.independent[own] < fit.model.inertial_count]
        ],
        axis=1,
    )
    found = _ratio(nominal - nominal.mean(axis=0), fitted - fitted.mean(axis=0))
    is_rotor_like = 1.0 < found.ratio < FAR_OFF and not beyond_rotors(fit, nominal).any()
    return Ratio(found.ratio, 0.0, np.inf) if is_rotor_like else found


def _ratio(known: Array, fitted: Array) -> Ratio:
    """Return the scale of torques (m, n) against those of known bodies, its interval by leaving out each joint in turn.

    The joints agree as well as the known bodies are right: a jackknife over them (Tukey 1958) with Student's t of their
    number less one; infinite where a single joint has such torques.
    """
    ratio, alike = scale_against(known, fitted)
    sizes, products = np.sum(known**2, axis=0), np.sum(known * fitted, axis=0)
    own = sizes > 0
    count = int(own.sum())
    if count < 2:
        return Ratio(ratio, alike, np.inf)
    without = (products.sum() - products[own]) / (sizes.sum() - sizes[own])
    deviation = np.sqrt((count - 1) / count * np.sum((without - without.mean()) ** 2))
    return Ratio(ratio, alike, float(student_quantile(0.975, count - 1) * deviation))


def _without_friction(fit: QuickFit, theta: Array) -> Array:
    """Return standard parameters (p,) of the bodies alone."""
    return np.where(np.arange(len(theta)) < fit.model.inertial_count, theta, 0.0)
