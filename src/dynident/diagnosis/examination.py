"""The examination of logs: checks in their order, of each log and of those together that one robot explains.

Checks of the raw file come first, then those of the signals, then those of a quick fit of all logs that are alike; an
error that no repair removes ends the examination, since what comes after it would only repeat it in other words.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Any

from dynident.case.case import Case
from dynident.case.case_values import find_file
from dynident.data.log_places import is_address
from dynident.diagnosis.case_lines import has_case_line, with_case_line
from dynident.diagnosis.causes.pooled_logs import UNLIKE, AlikeLogs, alike_parts, pooled_logs, unlike_finding
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.checks import CHECKS, Check, CheckedLog
from dynident.diagnosis.finding import SHORT, Finding, Severity, ordered
from dynident.diagnosis.recording import Recording, read_recording
from dynident.diagnosis.repair import Repaired, repair
from dynident.errors import DynidentError, LogFormatError, LogMismatch
from dynident.identification.estimate.estimate import Estimate
from dynident.model.threads import one_blas_thread

_STAGES = (0, 1, 2)

#: Name of the finding of joints that are at rest in all of a log.
STILL = "joint never moved"

#: Name of the finding of those that other logs move.
RESTS = "at rest in one log"

#: Errors that are gone once the safe repairs are made.
_MENDABLE = ("values that are not finite", "repeated rows", "rows out of order", "encoder wrap")

#: Duration in s of logs that are fitted together at most; of more logs the next ones are another fit. Times it where
#: joints are at rest in all of them until then.
LONGEST_S, FULL = 1200.0, 3.0

#: Logs that are named at most where some are examined together.
NAMED = 4


@dataclass(frozen=True)
class Examination:
    """Findings of the checks on one log.

    Attributes:
        path: The log.
        findings: Gravest first.
        left_out: Why checks were left out; empty where all were made.
        repaired: The log after the safe repairs; None where it could not be read.
        logs: The logs that were examined together; empty for one log.
    """

    path: str
    findings: tuple[Finding, ...]
    left_out: str = ""
    repaired: Repaired | None = None
    logs: tuple[str, ...] = ()

    @property
    def sound(self) -> bool:
        """Whether there is no finding at error level."""
        return not any(finding.severity == "error" for finding in self.findings)

    def figures(self) -> dict[str, Any]:
        """Return the examination as plain data for JSON."""
        return {
            "path": self.path,
            "sound": self.sound,
            "left_out": self.left_out,
            **({"logs": list(self.logs)} if self.logs else {}),
            "findings": [finding.figures() for finding in self.findings],
        }


def examine(case: Case, name: str, earlier: Estimate | None = None) -> Examination:
    """Return what is wrong with a log of a case; nothing is changed and nothing refused.

    Args:
        case: Robot, columns and preparation.
        name: The log, as the case or the command line names it.
        earlier: An estimate of the same robot, whose bodies take the place of the robot model's.

    Raises:
        FileError: The file cannot be read at all.
    """
    return examine_logs(case, [name], earlier)[0]


def examine_logs(
    case: Case,
    names: Sequence[str],
    earlier: Estimate | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> tuple[Examination, ...]:
    """Return what is wrong with several logs of a case; see :func:`examine_recordings`.

    Args:
        case: Robot, columns and preparation.
        names: The logs, as the case or the command line names them.
        earlier: An estimate of the same robot, whose bodies take the place of the robot model's.
        progress: Called with each step in words.

    Raises:
        FileError: A file cannot be read at all.
    """
    recordings: list[Recording] = []
    tests: list[bool] = []
    unreadable: dict[int, Examination] = {}
    for k, name in enumerate(names):
        progress(f"looking at {name}")
        try:
            recordings.append(read_recording(case, name))
            tests.append(_is_among(case, name, case.test) and not _is_among(case, name, case.train))
        except (LogFormatError, LogMismatch) as error:
            line = f"line {error.line}: " if isinstance(error, LogFormatError) and error.line else ""
            finding = Finding("error", "unreadable", "", f"{line}{error.evidence}", error.step)
            left_out = "no check was made, the file is no table of the case"
            unreadable[k] = Examination(str(case.find(name)), (finding,), left_out)
    unnamed = [one for one in case.train if not _is_among(case, one, names)]
    of_case = any(_is_among(case, name, (*case.train, *case.test)) for name in names)

    def moved(joints: set[str]) -> set[str]:
        """Return those of some joints that training logs move which were not named."""
        return joints - _still_in_all(case, unnamed, joints) if of_case else set()

    found = iter(examine_recordings(case, recordings, earlier, len(names), tests, moved))
    each = [unreadable[k] if k in unreadable else next(found) for k in range(len(names))]
    return (*each, *found)


def _is_among(case: Case, name: str, others: Sequence[str]) -> bool:
    """Return whether a log is one of others, however their paths are written."""
    return name in others or find_file(name, case.path).resolve() in {
        find_file(one, case.path).resolve() for one in others if not is_address(one)
    }


def _still_in_all(case: Case, names: Sequence[str], joints: set[str]) -> set[str]:
    """Return which of some joints are at rest in all of some logs, or in those that can be read."""
    check = CHECKS.make("position_range")
    for name in names if joints else ():
        try:
            raw = read_recording(case, name)
        except DynidentError:
            continue
        joints = joints & _still(check.findings(CheckedLog(case, raw, repair(raw, case.robot).recording)))
    return joints


def _still(found: Sequence[Finding]) -> set[str]:
    """Return the joints that findings tell to be at rest in all of a log."""
    return {name for each in found if each.name == STILL for name in each.joint.split(", ")}


@one_blas_thread()
def examine_recordings(
    case: Case,
    recordings: Sequence[Recording],
    earlier: Estimate | None = None,
    total: int = 0,
    tests: Sequence[bool] = (),
    moved: Callable[[set[str]], set[str]] = lambda joints: set(),
) -> tuple[Examination, ...]:
    """Return what is wrong with each recording of a case, and then with those together that are alike.

    What a fit shows is looked for in all logs together that one set of parameters explains, else in each log.

    Args:
        case: Robot, columns and preparation.
        recordings: One of each log.
        earlier: An estimate of the same robot, whose bodies take the place of the robot model's.
        total: How many logs there are with those that could not be read; 0 for those that are given.
        tests: Whether each is one to test on, from which nothing is learned; empty for none.
        moved: Returns those of some joints that logs beside these move.
    """
    checks = [CHECKS.make(name) for name in CHECKS.names()]
    seen = [_of_signals(checks, case, recording, earlier) for recording in recordings]
    for one, test in zip(seen, tests, strict=False):
        one.learns = not test
    _tell_moved_by_others(seen, moved)
    last = [check for check in checks if check.stage == _STAGES[-1]]
    parts = [_of_fits(last, group) for group in _groups([one for one in seen if not one.left_out])]
    _compare(case, parts)
    _tell_short_beside_others(seen)
    more: list[Examination] = []
    for part in parts:
        if part.together:
            name = _named(part.together, total or len(seen), len(parts) > 1)
            members = tuple(one.subject.raw.log.name for one in part.together)
            more.append(Examination(name, ordered(part.found), logs=members))
    return (*(one.examination() for one in seen), *more)


@dataclass(eq=False)
class _ExaminedLog:
    """A log whose signals were looked at.

    Attributes:
        subject: What checks see.
        repaired: The log after the safe repairs.
        found: Findings of the log.
        left_out: Why the checks that need a fit were left out; empty where they are made.
        others: Findings of the logs together of which it is one.
        rests: Joints that are at rest in all of it and that other logs move: alone it determines too little.
        learns: Whether it is one to learn from.
    """

    subject: CheckedLog
    repaired: Repaired
    found: list[Finding]
    left_out: str = ""
    others: Sequence[Finding] = ()
    rests: frozenset[str] = frozenset()
    learns: bool = True

    def leave_out(self, is_compared: bool) -> None:
        """Say that no fit was looked at, as it determines too little alone and no other logs go with it."""
        why = (
            "other logs do not go with it" if is_compared else "no log beside it moves them: name some that do as well"
        )
        self.left_out = f"checks that need a fit were left out: joints are at rest, and {why}"
        severity: Severity = "warning" if is_compared else "note"
        self.found = [replace(one, severity=severity) if one.name == RESTS else one for one in self.found]

    def examination(self) -> Examination:
        """Return what was found, less what findings of all logs together explain."""
        return Examination(self.subject.raw.log.name, ordered(self.found, self.others), self.left_out, self.repaired)


def _groups(ready: Sequence[_ExaminedLog]) -> Iterator[list[_ExaminedLog]]:
    """Yield logs one after another, as many as are fitted together at once."""
    group: list[_ExaminedLog] = []
    for one in ready:
        seconds = sum(each.subject.sound.log.duration for each in (*group, one))
        if group and seconds > LONGEST_S * (FULL if _rest_in_all(group) else 1.0):
            yield group
            group = []
        group.append(one)
    if group:
        yield group


def _rest_in_all(group: Sequence[_ExaminedLog]) -> frozenset[str]:
    """Return the joints that none of some logs moves."""
    return frozenset.intersection(*(one.rests for one in group))


@dataclass(frozen=True)
class _PartOfLogs:
    """Logs that may be fitted at once.

    Attributes:
        together: Those that were fitted together; empty where no two were.
        found: Findings of these, or of the one log.
        fit: Theirs; None where there is none of all.
    """

    together: Sequence[_ExaminedLog]
    found: list[Finding]
    fit: QuickFit | None


def _of_fits(checks: Sequence[Check], group: Sequence[_ExaminedLog]) -> _PartOfLogs:
    """Add what fits show to the findings of some logs; return those of them that were fitted together."""
    is_full = len(group) > 1 and not _rest_in_all(group)
    pooled = pooled_logs([one.subject.thin for one in group]) if is_full else AlikeLogs()
    if pooled.fit is not None and not pooled.fit.rows.masks.any(axis=0).all():  # some joint rests in all of them
        pooled = replace(pooled, fit=None, together=())
    together = [group[k] for k in pooled.together]
    told: list[Finding] = []
    if pooled.fit is not None:
        before = [finding for one in together for finding in one.found]
        told = _of_stage(checks, replace(together[0].subject, pooled=pooled.fit), before)
        for one in together:
            one.others = told
    apart = [k for k in range(len(group)) if k not in pooled.together]
    for k in apart:
        if group[k].rests:
            group[k].leave_out(len(pooled.ratios) > 0)
        else:
            group[k].found += _of_stage(checks, group[k].subject, group[k].found)
    own = [finding for one in group for finding in one.found]
    why = _may_be_why(told if together else own)
    if not any(finding.severity == "error" for finding in (*own, *told)):  # else that is why logs differ
        for k in apart if len(pooled.ratios) else ():
            if pooled.ratios[k].max() > UNLIKE:
                is_error, robot = k in pooled.contradicts and group[k].learns, group[k].subject.case.robot
                is_speed = k in pooled.other_speeds
                found = unlike_finding(robot, pooled.ratios[k], bool(together), why, is_error, is_speed)
                group[k].found.append(found)
    if len(group) == 1:
        return _PartOfLogs((), group[0].found, group[0].subject.fit)
    return _PartOfLogs(together, told, pooled.fit)


def _compare(case: Case, parts: Sequence[_PartOfLogs]) -> None:
    """Add to the findings of parts of many logs that parameters of the others do not explain that they are unlike."""
    known = [part for part in parts if part.fit is not None]
    if len(known) < 2:
        return
    kept, ratios = alike_parts([part.fit for part in known if part.fit is not None])
    for part, ratio in zip(known, ratios, strict=True):
        if ratio.max() > UNLIKE:
            part.found.append(unlike_finding(case.robot, ratio, bool(kept.any()), _may_be_why(part.found)))


def _may_be_why(found: Sequence[Finding]) -> bool:
    """Return whether findings hold a cause that may be why logs differ."""
    return any(each.severity == "warning" or each.name == "friction curve" for each in found)


def _named(together: Sequence[_ExaminedLog], total: int, is_part: bool) -> str:
    """Return how logs are called that were fitted together; a part of many begins at one of them."""
    if is_part:
        return f"{len(together)} of {total} logs, from {PurePath(together[0].subject.raw.log.name).name} on"
    if len(together) < total:
        names = [PurePath(one.subject.raw.log.name).name for one in together]
        told = names if len(names) <= NAMED else [*names[: NAMED - 1], "..."]
        return f"{len(together)} of {total} logs ({', '.join(told)})"
    return "both logs" if total == 2 else f"all {total} logs"


def _of_signals(checks: Sequence[Check], case: Case, recording: Recording, earlier: Estimate | None) -> _ExaminedLog:
    """Look at a file and its signals."""
    repaired = repair(recording, case.robot)
    subject = CheckedLog(case, recording, repaired.recording, earlier)
    found: list[Finding] = []
    for stage in _STAGES[:-1]:
        found += _of_stage([check for check in checks if check.stage == stage], subject, found)
        lasting = [each.name for each in found if each.severity == "error" and each.name not in _MENDABLE]
        if lasting:
            left_out = f"checks that need {'sound signals' if stage == 0 else 'a fit'} were left out: fix {lasting[0]}"
            return _ExaminedLog(subject, repaired, found, left_out)
    return _ExaminedLog(subject, repaired, found)


def _tell_moved_by_others(seen: Sequence[_ExaminedLog], moved: Callable[[set[str]], set[str]]) -> None:
    """Make a note of a joint that is at rest in one log and moves in another of those that are learned from."""
    still = [_still(one.found) for one in seen]
    there = zip(seen, still, strict=True)
    moving = [own for one, own in there if one.learns and (own or not one.left_out)]
    for one, rests in zip(seen, still, strict=True):
        unmoved = {name for name in rests if all(name in own for own in moving)}
        if not rests or (unmoved and moved(unmoved) != unmoved):
            continue
        for k, found in enumerate(one.found):
            if found.name == STILL:
                evidence = f"{found.evidence}; other logs move it"
                remedy = "logs are fitted and checked together where they agree; check the ones that do not"
                numbers, explains = found.numbers, found.explains
                one.found[k] = Finding("note", RESTS, found.joint, evidence, remedy, numbers, explains)
        if not any(found.severity == "error" and found.name not in _MENDABLE for found in one.found):
            one.left_out, one.rests = "", frozenset(rests)


def _tell_short_beside_others(seen: Sequence[_ExaminedLog]) -> None:
    """Make a note of a log that is too short for a fit where others that are learned from are not: these carry it."""
    too_short = [any(found.name == SHORT for found in one.found) for one in seen]
    if not any(one.learns and not (short or one.left_out) for one, short in zip(seen, too_short, strict=True)):
        return
    for one in seen:
        for k, found in enumerate(one.found):
            if found.name == SHORT:
                remedy = "the other logs carry the fit; causes of its own are not looked for in so few samples"
                one.found[k] = replace(found, severity="note", remedy=remedy)


def _of_stage(checks: Sequence[Check], subject: CheckedLog, before: Sequence[Finding]) -> list[Finding]:
    """Return the findings of some checks in their order; one is left out where others explain all that it can tell."""
    told: dict[int, Sequence[Finding]] = {}
    for k in sorted(range(len(checks)), key=lambda k: bool(checks[k].tells)):
        explained = {name for each in (before, *told.values()) for finding in each for name in finding.explains}
        names = set(checks[k].tells)
        told[k] = () if names and names <= explained else checks[k].findings(subject)
    found = [finding for k in sorted(told) for finding in told[k]]
    columns = subject.raw.columns_in(subject.case) if any(map(has_case_line, found)) else None
    if columns is None:  # else arrays, whose owner has no case file
        return found
    return [with_case_line(finding, columns, subject.case.robot, found) for finding in found]
