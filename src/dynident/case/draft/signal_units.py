"""The unit of each signal: what the header states, what the values support, and what has to be asked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.case.case_values import LEVER_ARM
from dynident.case.draft.joint_choice import outside_limits
from dynident.case.draft.yaml_words import few
from dynident.case.evidence.positions import STILL, is_plausible
from dynident.case.evidence.torques import agrees
from dynident.data.formats._units import RATED, counted_unit, unit_of
from dynident.model.joint import Joint

#: How the evidence begins where the name of a column has its unit.
HEADER = "the header states"

#: Positions of less span than this, in rad or m, and than this share of the limits say nothing about their unit.
_TELLING, _SHARE = 0.05, 0.1

#: Counts a turn of the usual register of a servo's position.
_REGISTER = 4096

#: How far positions in the unit that the header states may be beyond the middle of the limits, times what these allow:
#: another unit would be at least 57 times off.
_BEYOND = 2.0


@dataclass(frozen=True)
class SignalUnit:
    """The unit of a signal.

    Attributes:
        words: One word of the case file per joint (one for the time); empty where nothing is likely.
        certain: Whether it can be written down; else it is asked, and the words are the likely answer.
        why: The evidence.
        from_header: Whether the header of the file alone states it.
        may_differ: Whether joints may differ in it, so that the words are no answer that is offered.
    """

    words: tuple[str, ...]
    certain: bool
    why: str
    from_header: bool = False
    may_differ: bool = False

    @property
    def text(self) -> str:
        """The words as the case file writes them; empty where none is likely."""
        if self.may_differ:
            return ""
        if len(set(self.words)) <= 1:
            return self.words[0] if self.words else ""
        return f"[{', '.join(self.words)}]"


def position_unit(q: Array, joints: Sequence[Joint], stated: str, each: Sequence[str] = ()) -> SignalUnit:
    """Return the unit of positions, shape (N, n), from the limits of their joints and from what the header states.

    Args:
        q: The positions, in the file's units.
        joints: Their joints, n of them.
        stated: What the header states; empty for nothing.
        each: What it states for each joint where they differ; else empty.
    """
    words, certain, may_differ, reasons, resting = [], True, False, list[str](), list[str]()
    spans = np.ptp(q, axis=0)
    for mine, (si, other), said in _of_one_unit(joints, each or (stated,) * len(joints)):
        own = [joints[k] for k in mine]
        factors = {word: factor_of("position", word) for word in {si, other, said or si}}
        fits = {word: _fits(q[:, mine] * factor, own) for word, factor in factors.items()}
        widths = np.array([joint.limits.upper - joint.limits.lower for joint in own])
        telling = bool(np.any(spans[mine] >= np.minimum(_TELLING, _SHARE * widths)))
        if said and fits[said]:
            word, sure, why = said, True, f"the header states {said}, and the limits of the joints agree"
        elif said and not fits[si] and not fits[other] and _fits(q[:, mine] * factors[said], own, _BEYOND):
            word, sure, why = said, True, f"the header states {said}; values reach beyond the limits of the joints"
        elif fits[si] and not said and telling:
            word, sure = si, True
            why = f"within the limits as {si}; as {other} the largest motion would be {spans[mine].max():.3g} {other}"
        elif fits[si] and not said and spans[mine].max() < STILL and len(mine) < len(joints):
            word, sure, why = si, True, f"no motion; read as {si}, within the limits"
            resting += [si] if np.abs(q[:, mine]).max() >= STILL else []
        elif fits[si] and not said:
            word, sure = si, False
            why = f"within the limits as {si}, but the positions change by {spans[mine].max():.2g} only"
        else:
            away = f"values reach {np.abs(q[:, mine]).max():.4g}"
            word = other if fits[other] and said != si else ""
            sure, why = False, f"{away}, beyond the limits as {si}{f', within them as {other}' if fits[other] else ''}"
            why += "" if word else _of_counts(q[:, mine], own)
            turned = "" if said else _of_turned(q, joints, mine, other)
            if turned:
                word, why, may_differ = "", f"{away}, beyond the limits as {si}{turned}", True
            if word == "deg" and (doubt := _of_limits(own)):
                word, why = si, f"{why}; {doubt}"
            elif word == "deg" and 99.5 < np.abs(q[:, mine]).max() <= 100.0:
                word, why = "", f"{why}, or percent of the range, which has to be turned into deg"
            either = _of_either_unit(q, joints, mine, (si, other)) if word == other else ""
            why, may_differ = why + either, may_differ or bool(either)
        certain &= sure
        reasons.append(why)
        words.append((mine, word))
    named = {k: word for mine, word in words for k in mine}
    certain &= not resting or not {"deg", "mm"} & set(named.values())  # what stands may then be in these as well
    likely = tuple(named[k] for k in range(len(joints))) if all(named.values()) else ()
    return SignalUnit(likely, certain, "; ".join(reasons), may_differ=may_differ)


def _of_limits(joints: Sequence[Joint]) -> str:
    """Return that the limits of joints are those of radians read as degrees; nothing where they are larger."""
    ends = np.array([end for joint in joints for end in (joint.limits.lower, joint.limits.upper) if np.isfinite(end)])
    if not len(ends) or np.abs(ends).max() > np.radians(2.0 * np.pi) + 1e-6:
        return ""
    return (
        "no limit of the robot model is beyond 6.3 degrees, as of a file in radians that declares degrees "
        '(an MJCF lacks <compiler angle="radian"/> then)'
    )


def _of_one_unit(joints: Sequence[Joint], stated: Sequence[str]) -> Iterator[tuple[list[int], tuple[str, str], str]]:
    """Yield the places of the joints of a kind with one stated unit, the units that they may have, and that unit."""
    for kind, units in (("revolute", ("rad", "deg")), ("prismatic", ("m", "mm"))):
        said = [word if counted_unit(word)[1] in units else "" for word in stated]
        mine = [k for k, joint in enumerate(joints) if joint.kind == kind]
        for word in dict.fromkeys(said[k] for k in mine):
            yield [k for k in mine if said[k] == word], units, word


def _of_counts(q: Array, joints: Sequence[Joint]) -> str:
    """Return what is said of positions that are whole numbers, as registers of encoders are; nothing of others."""
    if np.any(q % 1.0):
        return ""
    widths = np.array([joint.limits.upper - joint.limits.lower for joint in joints])
    turn = float((2 * np.pi * np.ptp(q, axis=0) / widths).max())
    if turn > _REGISTER and joints[0].kind == "revolute":
        told = f"encoder counts, by the limits {turn:.2g} or more a turn of a joint: state 360 / (counts a turn) deg"
        return f"; whole numbers: {told}, of a motor before its gear with side: {{q: motor}} and the gear_ratio"
    zero = "; zero: -pi for each joint that stands at 0 at a count of 2048" if 0 <= q.min() <= q.max() <= 4096 else ""
    return f"; whole numbers: a count of 4096 a turn is 0.087890625 deg{zero}"


def _of_either_unit(q: Array, joints: Sequence[Joint], mine: Sequence[int], units: tuple[str, str]) -> str:
    """Return what is said of joints that move as a joint does in SI units, and hardly at all in the others' unit.

    Where these are most of those that move, the other joints are beyond limits that are not theirs: units seldom differ
    on one arm.
    """
    si, other = units
    spans, factor = np.ptp(q, axis=0), factor_of("position", other)
    moving = [k for k in mine if spans[k] >= _TELLING]
    doubtful = [
        k
        for k in mine
        if _fits(q[:, [k]], [joints[k]])
        and spans[k] * factor < _SHARE * (joints[k].limits.upper - joints[k].limits.lower) <= spans[k]
    ]
    if not doubtful or len(doubtful) == len(mine):
        return ""
    names = ", ".join(joints[k].name for k in doubtful)
    if 2 * len(doubtful) > len(moving):
        beyond = "; ".join(outside_limits([joints[k] for k in mine], q[:, mine]))
        told = (
            f"{len(doubtful)} of {len(moving)} joints{' that move' * (len(moving) < len(mine))} are within them as {si}"
        )
        told += f", and as {other} move"
        told += f" {spans[doubtful].max():.3g} {other} at most"
        return f"; {told}; {beyond}: correct these limits or the order of the columns"
    each = ", ".join(si if k in doubtful else other for k in range(len(joints)))
    moves = f"{spans[doubtful].max():.3g} {other} at most as {other}"
    return f"; {names} are within them as {si} too and move {moves}: [{each}] where units differ by joint"


def _of_turned(q: Array, joints: Sequence[Joint], mine: Sequence[int], other: str) -> str:
    """Return what is said of joints that are within their limits with the sign turned, where the others are as read."""
    spans, factor = np.ptp(q, axis=0), factor_of("position", other)
    beyond = [k for k in mine if not _fits(q[:, [k]], [joints[k]])]
    small = [spans[k] * factor < _SHARE * (joints[k].limits.upper - joints[k].limits.lower) for k in beyond]
    if not (all(small) and 0 < len(beyond) < len(mine) and all(_fits(-q[:, [k]], [joints[k]]) for k in beyond)):
        return ""
    names, does = ", ".join(joints[k].name for k in beyond), "are" if len(beyond) > 1 else "is"
    own = ["rad" if joint.kind == "revolute" else "m" for joint in joints]
    each = ", ".join("-" * (k in beyond) + word for k, word in enumerate(own))
    return f"; {names} {does} within them with the sign turned: [{each}], or the zero is another one"


def position_factors(told: SignalUnit, count: int) -> Array:
    """Return the factor of each of the columns of positions to SI by its unit, the likely one where it is asked."""
    words = told.words if len(told.words) == count else told.words[:1] * count or ("SI",) * count
    return np.array([factor_of("position", word) for word in words])


def torque_unit(
    joints: Sequence[Joint], stated: str, ratios: Array, telling: Sequence[bool], largest: Array
) -> SignalUnit:
    """Return the unit of torques.

    Args:
        joints: Their joints.
        stated: What the header states; empty for nothing.
        ratios: Logged torque over that of the robot model's inertias, by joint, shape (n,).
        telling: For which joints that ratio says something.
        largest: Largest torque of each joint in the file's unit, shape (n,).
    """
    si = tuple("N m" if joint.kind == "revolute" else "N" for joint in joints)
    seen = ratios[np.asarray(telling, bool)]
    limits = np.array([joint.limits.effort for joint in joints])
    over = bool(np.any(largest > 1.5 * limits))
    middle = float(np.median(np.abs(seen))) if len(seen) else float("nan")
    why = (
        f"{' to '.join(dict.fromkeys(f'{own:.2g}' for own in (np.abs(seen).min(), np.abs(seen).max())))} "
        "times the torque of the robot model's masses "
        f"on {len(seen)} of {len(joints)} joints"
        if len(seen)
        else "the robot model's masses give no evidence"
    )
    if stated:
        if stated in RATED:
            return SignalUnit((stated,) * len(joints), True, f"{HEADER} {stated}")
        fitting = not len(seen) or agrees(middle * (1e-3 if stated == "mN m" else 1.0))
        words = si if stated in ("N m", "N") else (stated,) * len(joints)
        return SignalUnit(words, fitting, f"the header states {stated}; {why}")
    if len(seen) and agrees(middle):
        return SignalUnit(si, True, why)
    if len(seen) and agrees(1e-3 * middle) and all(joint.kind == "revolute" for joint in joints):
        return SignalUnit(("mN m",) * len(joints), False, why)
    if len(seen) == 0 and np.all(np.isfinite(limits)) and not over and np.any(largest > 0.1 * limits):
        return SignalUnit(si, False, f"{why}; the values lie within the effort limits as N m")
    return SignalUnit(
        () if over or len(seen) else si, False, why + ("; the values exceed the effort limits" if over else "")
    )


def of_forces(told: SignalUnit, hinges: Sequence[str], stated: str) -> SignalUnit:
    """Return the unit of torques, asked where the names of the columns of joints that turn, ``hinges``, say force."""
    if not hinges:
        return told
    said = f"{HEADER} N" if stated.startswith("N") else "their names say force"
    return SignalUnit((), False, f"{said}, and {few(hinges, 4)} turn: {LEVER_ARM}; {told.why}")


def _fits(q: Array, joints: Sequence[Joint], times: float = 1.0) -> bool:
    """Return whether positions may be those of joints whose limits are so many ``times`` as far from their middles."""
    middles = np.array([(joint.limits.lower + joint.limits.upper) / 2 for joint in joints])
    middles[~np.isfinite(middles)] = 0.0
    q = middles + (q - middles) / times
    return all(map(is_plausible, joints, q.min(axis=0).tolist(), q.max(axis=0).tolist()))


def factor_of(quantity: str, word: str) -> float:
    """Return the factor of a unit to SI, the number before it included."""
    (numerator, denominator), _ = unit_of(quantity, word)
    return numerator / denominator
