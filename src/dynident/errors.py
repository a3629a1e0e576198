"""Every exception of dynident: one file, one tree.

A constructor takes the facts and keeps them as attributes; it writes the message: what happened, the evidence, the
next step. The command line prints the message on one line and exits with 1.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any


def nearest(word: str, choices: Iterable[str], alike: float = 0.5) -> str:
    """Return ``"; did you mean 'x'?"`` for the choice nearest to a mistyped word, or an empty string."""
    by_lower = {choice.lower(): choice for choice in choices}
    match = difflib.get_close_matches(word.lower(), by_lower, n=1, cutoff=alike)
    return f"; did you mean '{by_lower[match[0]]}'?" if match else ""


class DynidentError(Exception):
    """Base of every error that a user can act on."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (type(self), str(self), vars(self))  # an error may come from another process


def _restored(kind: type[DynidentError], text: str, facts: Mapping[str, Any]) -> DynidentError:
    error = kind.__new__(kind, text)
    error.__dict__.update(facts)
    return error


class UnknownChoice(DynidentError):
    """A name that is not in a family of parts, or not a joint, link or key that exists."""

    def __init__(self, what: str, name: str, choices: Sequence[str], aliases: Iterable[str] = ()) -> None:
        self.what, self.name, self.choices, self.aliases = what, name, tuple(choices), tuple(aliases)
        near = nearest(name, (*choices, *aliases))
        super().__init__(f"no {what} called '{name}'; choose one of: {', '.join(choices)}{near}")


class BrokenPart(DynidentError):
    """A part that an installed package adds and that cannot be used."""

    def __init__(self, what: str, name: str, evidence: str, step: str) -> None:
        self.what, self.name, self.evidence, self.step = what, name, evidence, step
        super().__init__(f"the {what} '{name}' cannot be used: {evidence}; {step}")


class MissingDependency(DynidentError):
    """An optional package is needed and not installed."""

    def __init__(self, what: str, package: str, extra: str) -> None:
        self.what, self.package, self.extra = what, package, extra
        super().__init__(f"{what} needs the package '{package}'; install it with: pip install 'dynident[{extra}]'")


class FileError(DynidentError):
    """A file that cannot be read or written at all."""

    def __init__(self, path: object, evidence: str, step: str) -> None:
        self.path, self.evidence, self.step = str(path), evidence, step
        super().__init__(f"{path}: {evidence}; {step}")


class DescriptionError(DynidentError):
    """A robot model or case file with a fault; ``where`` names the link, the joint, the line or the key."""

    def __init__(self, path: object, where: str, evidence: str, step: str) -> None:
        self.path, self.where, self.evidence, self.step = str(path), where, evidence, step
        place = f"{path}: {where}" if where else f"{path}"
        super().__init__(f"{place}: {evidence}; {step}")


class LogFormatError(DynidentError):
    """A log that cannot be understood; ``line`` is the line of the file, counted from 1."""

    def __init__(self, path: object, line: int | None, evidence: str, step: str) -> None:
        self.path, self.line, self.evidence, self.step = str(path), line, evidence, step
        place = f"{path}:{line}" if line else f"{path}"
        super().__init__(f"{place}: {evidence}; {step}")


class NoNumbers(LogFormatError):
    """Columns that hold no number in any or nearly any row, as the effort of a joint that has no sensor."""

    def __init__(self, path: object, line: int | None, columns: Sequence[str], evidence: str, step: str) -> None:
        self.columns = tuple(columns)
        super().__init__(path, line, evidence, step)


class LogMismatch(DynidentError):
    """A log that does not fit the robot, the model or the job asked for."""

    def __init__(self, log: str, evidence: str, step: str) -> None:
        self.log, self.evidence, self.step = log, evidence, step
        super().__init__(f"{log}: {evidence}; {step}")


class BadOption(DynidentError):
    """An option of a part or of a verb with a value it cannot take."""

    def __init__(self, option: str, value: object, step: str) -> None:
        self.option, self.value, self.step = option, value, step
        super().__init__(f"{_stated(option, value)}; {step}")

    def called(self, name: str) -> BadOption:
        """Return the same error with the option by another name, such as the flag that was typed."""
        return type(self)(name, self.value, self.step)


class BadArgument(BadOption):
    """An argument of a call from Python: what was seen where what is wanted, and the line that would work."""

    def __init__(self, argument: str, evidence: str, step: str) -> None:
        self.argument, self.evidence, self.option, self.value, self.step = argument, evidence, argument, evidence, step
        DynidentError.__init__(self, f"{argument}: {evidence}; {step}")


def check_kind(argument: str, value: object, kind: type, line: str) -> None:
    """Refuse an argument of another class with the line that works.

    Raises:
        BadArgument: It is of another one.
    """
    if not isinstance(value, kind):
        what = f"the text '{value}'" if isinstance(value, str) else f"a {type(value).__name__}"
        raise BadArgument(argument, f"{what} where a {kind.__name__} is wanted", f"write {line}")


def _stated(option: str, value: object) -> str:
    if value is None:
        return f"{option} is not given"
    if isinstance(value, str) and not value.strip():
        return f"{option} is empty"
    return f"{option} = {value!r} is not possible"


class PoorExcitation(DynidentError):
    """A log that does not determine what is asked of it."""

    def __init__(self, determined: int, wanted: int, evidence: str, step: str) -> None:
        self.determined, self.wanted, self.evidence, self.step = determined, wanted, evidence, step
        super().__init__(f"the log determines {determined} of {wanted} base parameters ({evidence}); {step}")


class NotConsistent(DynidentError):
    """Inertial parameters that no body can have, where a possible body is needed."""

    def __init__(self, owner: str, evidence: str, step: str) -> None:
        self.owner, self.evidence, self.step = owner, evidence, step
        super().__init__(f"{owner} is not physically consistent: {evidence}; {step}")


class ContradictoryConstraints(DynidentError):
    """Conditions stated for a robot that no robot can meet together; ``evidence`` names those that clash."""

    def __init__(self, evidence: str, step: str) -> None:
        self.evidence, self.step = evidence, step
        super().__init__(f"no robot meets all constraints: {evidence}; {step}")


class SolverFailed(DynidentError):
    """A numerical solver that did not reach a checked solution."""

    def __init__(self, solver: str, evidence: str, step: str) -> None:
        self.solver, self.evidence, self.step = solver, evidence, step
        super().__init__(f"{solver} found no solution: {evidence}; {step}")


class InfeasibleTrajectory(DynidentError):
    """Limits of a motion that cannot be kept together; ``bound`` names the worst of them, such as torque of joint2."""

    def __init__(self, bound: str, evidence: str, step: str) -> None:
        self.bound, self.evidence, self.step = bound, evidence, step
        super().__init__(f"no motion keeps the limits, above all {bound}: {evidence}; {step}")


class NotAccepted(DynidentError):
    """A log or an estimate that findings of the log checks at error level speak against."""

    def __init__(self, subject: str, evidence: str, step: str) -> None:
        self.subject, self.evidence, self.step = subject, evidence, step
        super().__init__(f"{subject}: {evidence}; {step}")


class EstimateFormatError(DynidentError):
    """An estimate file that is not one, is damaged or is of a version not known here."""

    def __init__(self, path: object, evidence: str, step: str) -> None:
        self.path, self.evidence, self.step = str(path), evidence, step
        super().__init__(f"{path}: {evidence}; {step}")


class TriangleFileError(DynidentError):
    """A triangle file that is not one, is damaged, or does not go with others."""

    def __init__(self, path: object, evidence: str, step: str) -> None:
        self.path, self.evidence, self.step = str(path), evidence, step
        super().__init__(f"{path}: {evidence}; {step}")


class PoolFailed(DynidentError):
    """Workers that cannot be had, are lost, or are not those that are needed."""

    def __init__(self, pool: str, evidence: str, step: str) -> None:
        self.pool, self.evidence, self.step = pool, evidence, step
        super().__init__(f"{pool}: {evidence}; {step}")
