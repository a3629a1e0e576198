"""What the page may ask for: each verb with its own choices, turned into the command line that does the same.

No text of the page becomes an option: files are files of the session, names are names of parts, numbers are numbers.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dynident.errors import BadOption, UnknownChoice
from dynident.studio.folder import Folder, kind_of

if TYPE_CHECKING:
    from dynident.exports.base import Exporter

#: Signals that the page maps, in the order of the file.
SIGNALS = ("q", "dq", "torque", "current", "q_ref", "dq_ref")

#: Quantities whose units the page asks for.
QUANTITIES = ("time", "position", "velocity", "torque", "current")

#: Exit codes of a fit or a validation that is done: criteria not met and not accepted are answers too.
_JUDGED = (0, 3, 4)

#: Largest number of names in one list.
_MOST = 100


@dataclass(frozen=True)
class Order:
    """A command that was asked for.

    Attributes:
        verb: The command's name.
        arguments: All its arguments, the verb first.
        outputs: Files that it writes, with names that are reserved in the folder.
        good: Exit codes that are an answer.
        limit: Time in s that it works at most, where it has such a limit; 0 else.
    """

    verb: str
    arguments: tuple[str, ...]
    outputs: tuple[str, ...] = ()
    good: tuple[int, ...] = (0,)
    limit: float = 0.0

    @property
    def command(self) -> str:
        """The command as it is typed."""
        return shlex.join(["dynident", *self.arguments])


class Asked:
    """The choices of a request, each checked when it is taken."""

    def __init__(self, folder: Folder, data: Mapping[str, Any]) -> None:
        self.folder, self._data = folder, data
        self.reserved: list[str] = []

    def output(self, stem: str, suffix: str) -> str:
        """Return a name that is reserved for a file which the command writes."""
        self.reserved.append(self.folder.reserve(stem, suffix))
        return self.reserved[-1]

    def file(self, key: str) -> str:
        """Return the name of a file of the session."""
        return self.folder.find(self._text(key)).name

    def optional(self, key: str) -> str:
        """Return the name of a file of the session; empty where the key is missing."""
        return self.file(key) if self._text(key) else ""

    def robot(self, key: str) -> str:
        """Return the name of a file of the session, or of a robot that ships."""
        from dynident.robot_files import shipped_robots

        name = self._text(key)
        return name if name in shipped_robots() and name not in self.folder.names() else self.file(key)

    def files(self, key: str) -> list[str]:
        """Return names of files of the session; none where the key is missing."""
        given = self._data.get(key) or []
        if not isinstance(given, list) or len(given) > _MOST:
            raise BadOption(key, given, "give a list of files of the session")
        return [self.folder.find(str(name)).name for name in given]

    def choice(self, key: str, choices: Sequence[str], what: str) -> str:
        """Return one of some names; empty where the key is missing."""
        name = self._text(key)
        if name and name not in choices:
            raise UnknownChoice(what, name[:60], choices)
        return name

    def choices(self, key: str, choices: Sequence[str], what: str) -> list[str]:
        """Return some of some names; none where the key is missing."""
        given = self._data.get(key) or []
        if not isinstance(given, list) or len(given) > _MOST:
            raise BadOption(key, given, f"give a list of names ({what})")
        for name in given:
            if name not in choices:
                raise UnknownChoice(what, str(name)[:60], choices)
        return [str(name) for name in given]

    def number(self, key: str, low: float, high: float, whole: bool = False) -> str:
        """Return a number within bounds as it is typed; empty where the key is missing."""
        given = self._data.get(key)
        if given is None or given == "":
            return ""
        try:
            value = float(given)
        except (TypeError, ValueError, OverflowError):
            value = math.nan
        if not low <= value <= high or (whole and value != round(value)):
            raise BadOption(key, given, f"give a {'whole ' * whole}number from {low:g} to {high:g}")
        return str(round(value)) if whole else f"{value:.10g}"

    def posture(self, key: str) -> str:
        """Return ``start`` or joint positions with commas between them; empty where the key is missing."""
        text = self._text(key).strip()
        if text in ("", "start"):
            return text
        try:
            values = [float(part) for part in text.split(",")]
        except ValueError:
            values = [math.nan]
        if not all(map(math.isfinite, values)):
            raise BadOption(key, text[:200], "write 'start', or the joint positions with commas between them")
        return ",".join(f"{value:.10g}" for value in values)

    def yes(self, key: str) -> bool:
        """Return whether a box is ticked."""
        return self._data.get(key) is True

    def _text(self, key: str) -> str:
        given = self._data.get(key, "")
        if not isinstance(given, str):
            raise BadOption(key, given, "give a text")
        return given


def order_of(folder: Folder, verb: str, data: Mapping[str, Any]) -> Order:
    """Return the command that a request asks for.

    Args:
        folder: The session.
        verb: Name of the command.
        data: Its choices as plain data.

    Raises:
        UnknownChoice: No such command, part or target.
        FileError: No such file.
        BadOption: A choice that cannot be.
    """
    if verb not in VERBS:
        raise UnknownChoice("command", verb[:60], tuple(VERBS))
    asked = Asked(folder, data)
    try:
        return VERBS[verb](asked)
    except BaseException:
        folder.release(asked.reserved)
        raise


def _init(asked: Asked) -> Order:
    from dynident.data.profiles import PROFILES

    logs = asked.files("logs")
    if not logs:
        raise BadOption("logs", [], "choose a log")
    arguments = ["init", asked.robot("robot"), *logs, *_listed("--test", asked.files("test"))]
    arguments += _option("--profile", asked.choice("profile", PROFILES.names(), "profile"))
    out = asked.output("case", ".yaml")
    return Order("init", (*arguments, "-o", out, "--json"), (out,))


def _check(asked: Asked) -> Order:
    arguments = ["check", asked.file("case"), *asked.files("logs")]
    out = (asked.output("fixed", ".csv"),) if asked.yes("fix") else ()
    return Order("check", (*arguments, *_listed("--fix", out), "--json"), out, good=(0, 1))


def _identify(asked: Asked) -> Order:
    from dynident.identification.estimators import ESTIMATORS
    from dynident.model.friction import FRICTION

    arguments = ["identify", asked.file("case"), *asked.files("logs"), *_listed("--test", asked.files("test"))]
    arguments += _option("--estimator", asked.choice("estimator", ESTIMATORS.names(), "estimator"))
    arguments += _listed("--friction", asked.choices("friction", ("auto", *FRICTION.names()), "friction part"))
    arguments += _option("--cutoff", asked.number("cutoff", 0.01, 10_000))
    if asked.yes("quick"):
        arguments += ["--cross-validate", "0", "--no-sensitivity"]
    out = asked.output("estimate", ".json")
    report = asked.output("report", ".html")
    return Order("identify", (*arguments, "-o", out, "--report", report), (out, report), good=_JUDGED)


def _validate(asked: Asked) -> Order:
    report = asked.output("validation", ".html")
    arguments = ["validate", asked.file("estimate"), *asked.files("logs"), "--report", report, "--json"]
    return Order("validate", tuple(arguments), (report,), good=_JUDGED)


def _report(asked: Asked) -> Order:
    out = asked.output("report", ".html")
    arguments = ["report", asked.file("estimate"), *_listed("--test", asked.files("test"))]
    plan = asked.optional("plan")
    return Order("report", (*arguments, *_option("--plan", plan), "-o", out), (out,))


def _excite(asked: Asked) -> Order:
    from dynident.excitation.criteria import CRITERIA
    from dynident.excitation.trajectories import TRAJECTORIES
    from dynident.model.friction import FRICTION

    arguments = ["excite", asked.robot("case")]
    arguments += _listed("--friction", asked.choices("friction", FRICTION.names(), "friction part"))
    arguments += _option("--trajectory", asked.choice("trajectory", TRAJECTORIES.names(), "trajectory"))
    arguments += _option("--criterion", asked.choice("criterion", CRITERIA.names(), "criterion"))
    arguments += _option("--period", asked.number("period", 0.5, 600))
    arguments += _option("--harmonics", asked.number("harmonics", 1, 50, whole=True))
    arguments += _option("--margin", asked.number("margin", 0, 0.9))
    arguments += _option("--torque-margin", asked.number("torque_margin", 0, 0.9))
    starts, limit = asked.number("starts", 1, 1000, whole=True), asked.number("time_limit", 1, 86_400)
    arguments += [*_option("--starts", starts), *_option("--time-limit", limit)]
    arguments += _option("--earlier", asked.optional("earlier"))
    out = asked.output("plan", ".json")
    arguments += ["-o", out]
    return Order("excite", tuple(arguments), (out,), limit=float(limit or 60.0))


def _diff(asked: Asked) -> Order:
    estimates = asked.files("estimates")
    if len(estimates) < 2:
        raise BadOption("estimates", estimates, "choose two or more")
    out = asked.output("difference", ".html")
    return Order("diff", ("diff", *estimates, "--html", out, "--json"), (out,))


def _compare(asked: Asked) -> Order:
    from dynident.identification.estimators import ESTIMATORS

    names = asked.choices("estimators", ESTIMATORS.names(), "estimator")
    if not names:
        raise BadOption("estimators", [], "choose two or more")
    out = asked.output("comparison", ".html")
    arguments = ["compare", asked.file("case"), "--estimators", ",".join(names)]
    arguments += _option("--time-limit", asked.number("time_limit", 1, 86_400))
    return Order("compare", (*arguments, "--report", out, "--json"), (out,), good=_JUDGED)


def _export(asked: Asked) -> Order:
    file = asked.file("file")
    place = asked.folder.find(file)
    known = targets(kind_of(place, place.stat().st_mtime_ns, place.stat().st_size))
    known = known or targets("plan") | targets("estimate")  # the command says what is wrong with the file
    target = asked.choice("to", tuple(known), "target")
    if not target:
        raise BadOption("to", "", "choose a target")
    out = asked.output("exported", known[target].suffix)
    arguments = ["export", file, "--to", target, "-o", out, "--json"]
    arguments += _option("--speed", asked.number("speed", 10, 100))
    posture = asked.posture("posture")
    arguments += [f"--from-posture={posture}"] if posture else []
    description = asked.optional("description")
    arguments += ["--force"] if asked.yes("force") else []
    return Order("export", (*arguments, *_option("--description", description)), (out,))


def targets(kind: str) -> dict[str, type[Exporter[Any, Any]]]:
    """Return the targets of ``dynident export`` for a kind of file, by name; the page can only hand out files.

    Args:
        kind: What the file is: ``plan``, ``estimate``; anything else has none.
    """
    from dynident.exports.models import MODEL_EXPORTERS
    from dynident.exports.motions import MOTION_EXPORTERS

    parts = ((name, family.get(name)) for family in (MOTION_EXPORTERS, MODEL_EXPORTERS) for name in family.names())
    return {name: part for name, part in parts if part.takes == kind and not part.writes_folder}


def _option(name: str, value: str) -> list[str]:
    return [name, value] if value else []


def _listed(name: str, values: Sequence[str]) -> list[str]:
    return [name, *values] if values else []


VERBS: dict[str, Callable[[Asked], Order]] = {
    "init": _init,
    "check": _check,
    "identify": _identify,
    "validate": _validate,
    "report": _report,
    "excite": _excite,
    "diff": _diff,
    "compare": _compare,
    "export": _export,
}
