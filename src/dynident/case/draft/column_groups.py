"""Columns that belong together: one per joint, told by a number in their names or by the names of the joints."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from dynident.case.draft.column_words import OTHER, Meaning, container_of, meaning_of, split_unit, tokens_of, words_of
from dynident.model.robot import Robot

#: Numbers in one name that may be that of the joint; a name with more is no joint's.
_MOST_NUMBERS = 4

#: Units of slides and of joints that turn.
_OF_KINDS: Mapping[str, frozenset[str]] = {
    "prismatic": frozenset(("m", "mm", "m/s", "mm/s", "N")),
    "revolute": frozenset(("rad", "deg", "rad/s", "deg/s", "N m", "mN m")),
}

#: A column of a recording of several topics, and topics that are joined at most.
_TOPIC, _MOST_TOPICS = re.compile(r"(/[^:]+):(.+)"), 6

#: Words for the side of an arm that names of joints begin with.
_SIDES = (("left",), ("right",))

#: Words of joint names that columns often leave out.
_GENERIC = frozenset(("joint", "jnt", "j"))


@dataclass(frozen=True)
class Group:
    """Columns of one signal.

    Attributes:
        meaning: What their names say.
        columns: Column by joint: its place in the robot, counted from 0, or its number in the names.
        named: Whether the joints are told by their names; else by numbers.
        pattern: How the case file writes the columns, such as ``q_{0}``; empty where only a list says them.
        units: Unit in the name of each column, in the order of their joints, where they differ; else empty.
        told_by: The columns whose cells name the joints; empty where the names of the columns do.
    """

    meaning: Meaning
    columns: Mapping[int, str]
    named: bool
    pattern: str = ""
    units: tuple[str, ...] = ()
    told_by: str = ""

    @property
    def count(self) -> int:
        """Number of columns."""
        return len(self.columns)

    @property
    def names(self) -> tuple[str, ...]:
        """The columns, in the order of their joints."""
        return tuple(self.columns[key] for key in sorted(self.columns))

    def shown(self) -> str:
        """Return the group in words, such as ``q1 to q6``."""
        names = self.names
        return names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"


@dataclass(frozen=True)
class StatedJoints:
    """The joints that cells of a log name, as messages of ROS do.

    Attributes:
        names: In the order of the numbered columns; empty where no cell names one.
        columns: The columns of these names.
    """

    names: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()

    @property
    def shown(self) -> str:
        """The columns in words, such as ``name[0] to name[5]``."""
        return " to ".join(dict.fromkeys((self.columns[0], self.columns[-1]))) if self.columns else ""

    def places(self, joints: Sequence[str]) -> list[int | None]:
        """Return the place of each name among a robot's joints; None where it is none of them or not alone."""
        forms = joint_forms(joints)
        words = [joint_in(tokens_of(name), forms) for name in self.names]
        found = [
            joints.index(name) if name in joints else place and place[0]
            for name, place in zip(self.names, words, strict=True)
        ]
        return [place if found.count(place) == 1 else None for place in found]

    def named(self, group: Group, joints: Sequence[str]) -> Group:
        """Return a group of numbered columns, as many as there are names, with the joints of the robot among them."""
        places = self.places(joints) if self.names and not group.named and group.count == len(self.names) else []
        columns = {place: name for place, name in zip(places, group.names, strict=False) if place is not None}
        units = dict(zip(places, group.units, strict=False))
        each = tuple(units[place] for place in sorted(columns)) if units else ()
        if not columns:
            return group
        return replace(group, columns=columns, named=True, pattern="", units=each, told_by=self.shown)


def groups_of(header: Sequence[str], joints: Sequence[str]) -> list[Group]:
    """Return the groups of joint columns in a header, those told by names of joints first.

    Args:
        header: Names of the columns.
        joints: Names of the joints of the robot, in order.
    """
    return [*_named_groups(header, joints), *_numbered_groups(header, len(joints))]


def groups_of_robot(header: Sequence[str], robot: Robot, stated: StatedJoints) -> list[Group]:
    """Return the groups of joint columns; one where the slides and the joints that turn have a group each.

    Of these the units in the names tell one from the other, and their counts are those of such joints of the robot.

    Args:
        header: Names of the columns.
        robot: With all its joints.
        stated: The joints of numbered columns that cells name.
    """
    groups = [stated.named(group, robot.joint_names) for group in groups_of(header, robot.joint_names)]
    kinds = {kind: [k for k, joint in enumerate(robot.active) if joint.kind == kind] for kind in _OF_KINDS}
    if not all(kinds.values()):
        return groups
    found, taken = list[Group](), list[Group]()
    for one, other in combinations([*groups, *_single_columns(header, groups)], 2):
        of = {_kind_of(group): group for group in (one, other)}
        same = replace(one.meaning, unit="", strange=()) == replace(other.meaning, unit="", strange=())
        counts = {kind: len(places) for kind, places in kinds.items()}
        if same and not (one.named or other.named) and {kind: group.count for kind, group in of.items()} == counts:
            found.append(_of_kinds(of, kinds))
            taken += [one, other]
    return [*found, *(group for group in groups if group not in taken)]


def _single_columns(header: Sequence[str], groups: Sequence[Group]) -> Iterator[Group]:
    """Yield the columns without a number and a joint that have a signal and a unit in their names."""
    known, container = {name for group in groups for name in group.names}, container_of(header)
    for name in header:
        base, unit = split_unit(name)
        words = words_of(base, container)
        meaning = meaning_of(words, unit)
        if name not in known and not any(word.isdigit() for word in words) and meaning.unit:
            yield Group(meaning, {1: name}, False)


def _kind_of(group: Group) -> str:
    """Return the kind of the joints of a group by the unit in its names; empty where it has none."""
    return next((kind for kind, units in _OF_KINDS.items() if group.meaning.unit in units), "")


def _of_kinds(groups: Mapping[str, Group], places: Mapping[str, Sequence[int]]) -> Group:
    """Return one group of those of the slides and of the joints that turn, in the order of the joints."""
    columns, units = dict[int, str](), dict[int, str]()
    for kind, group in groups.items():
        columns |= dict(zip(places[kind], group.names, strict=True))
        units |= dict.fromkeys(places[kind], group.meaning.unit)
    strange = tuple(dict.fromkeys(word for group in groups.values() for word in group.meaning.strange))
    meaning = replace(groups["revolute"].meaning, unit="", strange=strange)
    return Group(meaning, columns, False, units=tuple(units[k] for k in sorted(units)))


def single_temperatures(header: Sequence[str]) -> list[str]:
    """Return the columns that are temperatures by their names, without the number of a joint."""
    found = []
    for name in header:
        base, unit = split_unit(name)
        words = words_of(base, container_of(header))
        if not any(word.isdigit() for word in words) and meaning_of(words, unit).signal == "temperature":
            found.append(name)
    return found


def _named_groups(header: Sequence[str], joints: Sequence[str]) -> list[Group]:
    """Return groups whose columns have the names of joints, whole or without words such as 'joint'.

    Those of several topics of a recording are one where each joint is in one of them; else there is one group for each
    choice of topics.
    """
    found: dict[Meaning, dict[str, dict[Meaning, dict[int, str]]]] = {}
    forms, container = joint_forms(joints), container_of(header)
    for name in header:
        place = _named_column(name, forms, container)
        if place is not None:
            joint, meaning = place
            topics = found.setdefault(replace(meaning, unit=""), {})
            topics.setdefault(_topic_of(name)[0], {}).setdefault(meaning, {}).setdefault(joint, name)
    groups = list[Group]()
    for meaning, topics in found.items():
        own = [group for parts in topics.values() for group in _by_unit(meaning, parts, joints)]
        groups += _joined(own, joints) if len(own) == len(topics) > 1 else own
    return [group for group in groups if group.count > 1 or len(joints) == 1]


def _topic_of(name: str) -> tuple[str, str]:
    """Return the topic of a recording in front of the name of a column, empty for none, and the rest of the name."""
    found = _TOPIC.fullmatch(name)
    return (found[1], found[2]) if found else ("", name)


def _named_column(name: str, forms: Mapping[tuple[str, ...], int], container: str) -> tuple[int, Meaning] | None:
    """Return the joint whose name stands in that of a column, and what the rest says; None where one is missing."""
    topic, field = _topic_of(name)
    base, unit = split_unit(field)
    words = words_of(base, container)
    place = joint_in(words, forms)
    if place is None:
        return None
    joint, start, length = place
    rest = words[:start] + words[start + length :]
    if any(word.isdigit() for word in rest):
        return None
    meaning = meaning_of(rest, unit, at_end=start + length < len(words))
    outer = meaning_of(tokens_of(topic))
    if topic and (OTHER.intersection(tokens_of(topic)) or not meaning.signal):
        return None
    kind = outer.kind if outer.kind in ("commanded", "model") else meaning.kind or outer.kind
    return (joint, replace(meaning, kind=kind)) if meaning.signal not in ("", "time") else None


def joint_columns(header: Sequence[str], joints: Sequence[str]) -> dict[int, list[str]]:
    """Return the columns in whose names that of a joint stands, by its place among the joints."""
    forms, found = joint_forms(joints), dict[int, list[str]]()
    for name in header:
        place = joint_in(tokens_of(_topic_of(name)[1]), forms)
        if place is not None:
            found.setdefault(place[0], []).append(name)
    return found


def _joined(groups: Sequence[Group], joints: Sequence[str]) -> list[Group]:
    """Return groups of one signal, each of a topic, as one for each largest set of them that shares no joint."""
    if len(groups) > _MOST_TOPICS:
        return list(groups)
    sets = list[set[int]]()
    for size in range(len(groups), 0, -1):
        for places in combinations(range(len(groups)), size):
            columns = [joint for k in places for joint in groups[k].columns]
            if len(columns) == len(set(columns)) and not any(set(places) <= known for known in sets):
                sets.append(set(places))
    found = list[Group]()
    for places in sets:
        columns = {joint: name for k in sorted(places) for joint, name in groups[k].columns.items()}
        units = {j: u for k in places for j, u in zip(sorted(groups[k].columns), _units_of(groups[k]), strict=True)}
        same = len(set(units.values())) == 1
        meaning = replace(groups[0].meaning, unit=next(iter(units.values())) if same else "")
        each = () if same else tuple(units[joint] for joint in sorted(units))
        found.append(Group(meaning, columns, True, _joint_pattern(columns, joints) if same else "", each))
    return found


def _units_of(group: Group) -> tuple[str, ...]:
    return group.units or (group.meaning.unit,) * group.count


def _by_unit(meaning: Meaning, parts: Mapping[Meaning, Mapping[int, str]], joints: Sequence[str]) -> Iterator[Group]:
    """Yield the columns of a signal as one group; as one of each unit where a joint has columns in two of them."""
    units = {joint: own.unit for own, columns in parts.items() for joint in columns}
    if len(parts) > 1 and len(units) == sum(map(len, parts.values())):
        columns = {joint: name for one in parts.values() for joint, name in one.items()}
        yield Group(meaning, columns, True, units=tuple(units[joint] for joint in sorted(units)))
        return
    for own, columns in parts.items():
        yield Group(own, columns, True, _joint_pattern(columns, joints))


def joint_forms(joints: Sequence[str]) -> dict[tuple[str, ...], int]:
    """Return the words that stand for each joint; those that stand for two of them are left out.

    What all names begin with may be missing where a letter and a number are left, as ``s0``; the side of an arm may
    stand behind.
    """
    forms: dict[tuple[str, ...], int] = {}
    doubtful: set[tuple[str, ...]] = set()
    names = [tuple(tokens_of(joint)) for joint in joints]
    shared = next((k for k, words in enumerate(zip(*names, strict=False)) if len(set(words)) > 1), 0)
    for k, words in enumerate(names):
        short = tuple(word for word in words if word not in _GENERIC)
        own = tuple(word for word in words[shared:] if word not in _GENERIC)
        own = own if re.search("[a-z].*[0-9]", " ".join(own)) else short
        turned = (*words[1:], words[0]) if words[:1] in _SIDES else words
        for form in {words, short, own, turned}:
            if not form or all(word.isdigit() for word in form):
                continue
            if forms.get(form, k) != k:
                doubtful.add(form)
            forms[form] = k
    return {form: joint for form, joint in forms.items() if form not in doubtful}


def joint_in(words: Sequence[str], forms: Mapping[tuple[str, ...], int]) -> tuple[int, int, int] | None:
    """Return the joint whose words stand in a name, where, and how many; the longest form wins."""
    for length in range(len(words), 0, -1):
        for start in range(len(words) - length + 1):
            joint = forms.get(tuple(words[start : start + length]))
            if joint is not None:
                return joint, start, length
    return None


def _joint_pattern(columns: Mapping[int, str], joints: Sequence[str]) -> str:
    patterns = {name.replace(joints[k], "{joint}", 1) if joints[k] in name else "" for k, name in columns.items()}
    pattern = patterns.pop() if len(patterns) == 1 else ""
    return pattern if pattern.count("{") == 1 else ""


def _numbered_groups(header: Sequence[str], count: int) -> list[Group]:
    """Return groups whose names differ in one number, and perhaps in their units.

    The number runs from 0 or 1; of a column for each of ``count`` joints from any, as the addresses of drives do.
    """
    holes: dict[tuple[str, str], dict[int, str]] = {}
    twice: set[tuple[str, str]] = set()
    for name in header:
        numbers = list(re.finditer(r"\d+", name))
        if not 0 < len(numbers) <= _MOST_NUMBERS:
            continue
        base = split_unit(name)[0]
        for number in numbers:
            for text in dict.fromkeys((name, base)):
                key = (text[: number.start()], text[number.end() :])
                if text != name and int(number[0]) in holes.get(key, {}):
                    twice.add(key)  # the unit alone tells these columns apart
                holes.setdefault(key, {}).setdefault(int(number[0]), name)
    holes = {key: columns for key, columns in holes.items() if key not in twice}
    found, container = [], container_of(header)
    taken: set[str] = set()
    for (before, after), columns in sorted(holes.items(), key=lambda item: -len(item[1])):
        run = _run(columns, count)
        if not run or taken.intersection(run.values()):
            continue
        units = tuple(split_unit(run[number])[1] for number in sorted(run))
        base, unit = split_unit(f"{before}\0{after}")
        unit = units[0] if len(set(units)) == 1 else unit
        words = [word for word in words_of(base.replace("\0", " "), container) if not word.isdigit()]
        meaning = meaning_of(words, unit, at_end=bool(tokens_of(base.partition("\0")[2])))
        bare = len(run) == 1 and not meaning_of(words).signal  # the unit alone says what one column is
        if meaning.signal and meaning.signal != "time" and not bare:
            taken.update(run.values())
            several = units if len(set(units)) > 1 else ()
            found.append(Group(meaning, run, False, _number_pattern(before, after, run), several))
    order = {name: k for k, name in enumerate(header)}
    return sorted(found, key=lambda group: order[group.names[0]])


def _run(columns: Mapping[int, str], count: int) -> dict[int, str]:
    """Return the columns whose numbers run from 0, or from 1, without a gap; ``count`` of them from any number."""
    first = 0 if 0 in columns else 1 if 1 in columns or len(columns) != count else min(columns)
    run = {}
    while first + len(run) in columns:
        run[first + len(run)] = columns[first + len(run)]
    return run if len(run) == len(columns) else {}


def _number_pattern(before: str, after: str, run: Mapping[int, str]) -> str:
    mark = "{0}" if 0 in run else "{}"
    if any(sign in before + after for sign in "{}") or not {0, 1} & run.keys():
        return ""
    return f"{before}{mark}{after}" if all(name == f"{before}{k}{after}" for k, name in run.items()) else ""
