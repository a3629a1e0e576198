"""Which group of columns is which signal: what is measured before what is told, and two that fit equally are asked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from dynident.case.draft.column_groups import Group
from dynident.case.draft.column_words import KIND, tokens_of
from dynident.data.profiles import unmeasured

#: Signals that are looked for.
SIGNALS = ("q", "dq", "torque", "current", "temperature")

#: Words for what a drive takes for its torque; what other models give is not all of it.
_ESTIMATED = frozenset(("est", "estimated"))


@dataclass(frozen=True)
class SignalChoice:
    """The columns of the signals.

    Attributes:
        groups: Group by signal; ``q_ref`` and ``dq_ref`` are commanded ones.
        rivals: Groups that fit as well as the first, by signal; the user has to say which.
        refused: Groups that hold commands or values of a model where a measurement is wanted, with the reason.
        without_effort: Positions of joints, by their place in the robot, that have neither torques nor currents as the
            others do; these are in no group.
    """

    groups: Mapping[str, Group] = field(default_factory=dict)
    rivals: Mapping[str, tuple[Group, ...]] = field(default_factory=dict)
    refused: tuple[tuple[Group, str], ...] = ()
    without_effort: Mapping[int, str] = field(default_factory=dict)


def choose_signals(groups: Sequence[Group], joints: int, effort_only: bool = False) -> SignalChoice:
    """Return which groups are which signals.

    Args:
        groups: All groups of the header.
        joints: Number of joints of the robot.
        effort_only: Whether the positions are known already, and only torques and currents are looked for.
    """
    refused = tuple((group, why) for group in groups if (why := why_refused(group)))
    sound = [group for group in groups if group not in [bad for bad, _ in refused]]
    if effort_only:
        efforts = {signal: _best([g for g in sound if g.meaning.signal == signal], joints) for signal in SIGNALS[2:4]}
        return SignalChoice({signal: best[0] for signal, best in efforts.items() if len(best) == 1})
    positions = _best([group for group in sound if group.meaning.signal == "q"], joints)
    if not positions:
        return SignalChoice(refused=refused)
    sound, held = _with_efforts(sound, positions[0], [group for group, _ in refused if _is_estimated(group)])
    positions = _best([group for group in sound if group.meaning.signal == "q"], joints)
    first = positions[0]
    chosen, rivals = {"q": first}, {"q": tuple(positions)} if len(positions) > 1 else {}
    for signal in SIGNALS[1:]:
        alike = [g for g in sound if g.meaning.signal == signal and _same_joints(g, first)]
        best = _best(alike, joints)
        if best:
            chosen[signal] = best[0]
        if len(best) > 1:
            rivals[signal] = tuple(best)
    for signal in ("q", "dq"):
        told = [g for g, _ in refused if g.meaning.signal == signal and g.meaning.kind == "commanded"]
        best = _best([g for g in told if _same_joints(g, first)], joints)
        if len(best) == 1:
            chosen[f"{signal}_ref"] = best[0]
    read = {name for group in chosen.values() for name in group.names}
    left = tuple((group, why) for group, why in refused if not read & set(group.names))
    return SignalChoice(chosen, rivals, left, held)


def _with_efforts(
    sound: Sequence[Group], first: Group, estimated: Sequence[Group]
) -> tuple[list[Group], Mapping[int, str]]:
    """Return the groups with the torques that drives estimate where nothing else is there, of joints that have efforts.

    Args:
        sound: The groups of measurements.
        first: The positions.
        estimated: Torques that drives estimate.

    Returns:
        The groups, and the columns of positions of joints without torques or currents.
    """
    efforts = [group for group in sound if group.meaning.signal in SIGNALS[2:4]]
    found = [*sound, *(() if efforts else estimated)]
    efforts = efforts or list(estimated)
    if any(_same_joints(group, first) for group in efforts):
        return found, {}
    parts = [group for group in efforts if first.named and group.named and set(group.columns) < set(first.columns)]
    if not parts:
        return found, {}
    most = max(parts, key=lambda group: group.count)
    held = {k: name for k, name in first.columns.items() if k not in most.columns}
    return [_only(group, most) if group.named else group for group in found], held


def _only(group: Group, other: Group) -> Group:
    """Return the columns of a group of the joints of another one, where it has all of them."""
    if not set(other.columns) <= set(group.columns):
        return group
    kept = [k for k, joint in enumerate(sorted(group.columns)) if joint in other.columns]
    units = tuple(group.units[k] for k in kept) if group.units else ()
    return replace(group, columns={joint: group.columns[joint] for joint in sorted(other.columns)}, units=units)


def _is_estimated(group: Group) -> bool:
    """Return whether a group is what drives take for their torques by its names, and no other value of a model."""
    words = {word for word in tokens_of(group.names[0]) if KIND.get(word) in ("model", "commanded")}
    return group.meaning.signal == "torque" and bool(words) and words <= _ESTIMATED


def why_refused(group: Group) -> str:
    """Return why a group is no measurement; empty where it may be one."""
    known = unmeasured(group.names[0])
    if known is not None:
        return f"{known[1].kind} ({known[0]})"
    if group.meaning.kind in ("commanded", "model"):
        return f"{group.meaning.kind} by its name"
    return ""


def _best(groups: Sequence[Group], joints: int) -> list[Group]:
    """Return the best of some groups of one signal, and those that are as good."""
    if not groups:
        return []

    def rank(group: Group) -> tuple[int, ...]:
        meaning = group.meaning
        covers = 0 if group.count == joints else 1 if group.count < joints else 2
        side = {"link": 0, "": 1, "motor": 2}[meaning.side]
        return (covers, 0 if meaning.kind == "measured" else 1, side, len(meaning.strange))

    least = min(map(rank, groups))
    found = [group for group in groups if rank(group) == least]
    named = [group for group in found if group.named]
    return _distinct(named or found)


def _distinct(groups: Sequence[Group]) -> list[Group]:
    """Return groups without those that share columns with an earlier one; sets of topics by joint names may."""
    found: list[Group] = []
    for group in groups:
        if group.named or not any(set(group.names) & set(other.names) for other in found):
            found.append(group)
    return found


def _same_joints(group: Group, first: Group) -> bool:
    if group.named != first.named:
        return group.count == first.count
    return set(group.columns) == set(first.columns) or group.count == first.count
