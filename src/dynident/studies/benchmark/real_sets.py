"""The scoreboard on real logs: every method on every set and split, beside figures that others have published."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from dynident.arrays import plain
from dynident.case.case import Case, read_case
from dynident.case.case_values import guarded, texts
from dynident.case.prior_file import read_prior
from dynident.data.log import Log
from dynident.data.preprocessing import FILTERS
from dynident.data.split import Split
from dynident.errors import DescriptionError, DynidentError, FileError
from dynident.file_versions import Document, FileVersions, renamed
from dynident.files import bytes_of, sha256_of
from dynident.identification.build_problem import PriorKnowledge, build_problem
from dynident.identification.estimators import ESTIMATORS
from dynident.model.documents.sections import Section
from dynident.robot_files.strict_yaml import load_yaml
from dynident.studies.benchmark.runner import failed
from dynident.studies.comparison.compare import contest_of
from dynident.studies.comparison.contest import Contest, Method

#: The file in a folder of cases that states sets and published figures.
SCOREBOARD = "scoreboard.yml"


def _to_2(data: Document) -> Document:
    return renamed(data, {"published[].held_out_error": "test_error"})


VERSIONS = FileVersions("a scoreboard", (_to_2,), key="scoreboard")

_SET = ("name", "case", "train", "test", "split", "cutoff_hz", "trim_s")
_FIGURE = ("set", "who", "test_error", "training_error", "rmse_unfiltered", "source", "remark")


@dataclass(frozen=True)
class RealSet:
    """A case with the logs and the split of one row of the scoreboard.

    Attributes:
        name: What it is called.
        case: Robot, friction, filter.
        train: Logs to learn from.
        test: Logs to test on; empty where a split makes them.
        split: How logs are split; None where they are not.
    """

    name: str
    case: Case
    train: tuple[str, ...]
    test: tuple[str, ...]
    split: Split | None

    @property
    def missing(self) -> tuple[str, ...]:
        """Logs that are not there."""
        files = [self.case.find(name) for name in (*self.train, *self.test)]
        return tuple(dict.fromkeys(str(file) for file in files if not file.is_file()))


@dataclass(frozen=True)
class Published:
    """A figure that somebody has published.

    Attributes:
        set: Name of the set.
        who: Who, and by what method.
        test_error: |residual| / |torque| on unseen rows; None where it is not stated.
        training_error: The same on the rows of the fit; None where it is not stated.
        rmse_unfiltered: Root mean square errors against the torque before any filter, joint by joint; empty for none.
        source: Where it stands.
        remark: What keeps it from being compared line by line; empty for nothing.
    """

    set: str
    who: str
    test_error: float | None
    training_error: float | None
    rmse_unfiltered: tuple[float, ...]
    source: str
    remark: str


@dataclass(frozen=True)
class Scoreboard:
    """What a folder of cases asks for."""

    sets: tuple[RealSet, ...]
    published: tuple[Published, ...]


def read_scoreboard(folder: str | Path) -> Scoreboard:
    """Read the sets of a folder: those of its scoreboard.yml, or each of its case files as it stands.

    Raises:
        DescriptionError: A fault in the file or in a case, with the key.
        FileError: No such folder, or one without cases.
    """
    place = Path(folder)
    if not place.is_dir():
        raise FileError(folder, "there is no such folder", "give a folder with case files, such as examples/cases")
    file = place / SCOREBOARD
    if file.is_file():
        return _stated(file)
    cases = sorted(place.glob("*.yaml"))
    if not cases:
        raise FileError(folder, "it has no case file (*.yaml)", "give a folder with case files")
    return Scoreboard(tuple(_as_it_stands(path.stem, read_case(path)) for path in cases), ())


def _as_it_stands(name: str, case: Case) -> RealSet:
    return RealSet(name, case, case.train, case.test, case.split)


def _stated(file: Path) -> Scoreboard:
    value, lines = load_yaml(file, bytes_of(file))
    top = Section.versioned(file, value, ("scoreboard", "sets", "published"), lines, VERSIONS)
    sets = tuple(_set(file.parent, section) for section in top.sections("sets", _SET))
    names = [each.name for each in sets]
    if not names or len(set(names)) != len(names):
        raise top.place("sets").error(f"the names {names}", "state at least one set, each with a name of its own")
    published = tuple(_figure(section, names) for section in top.sections("published", _FIGURE))
    return Scoreboard(sets, published)


def _set(folder: Path, section: Section) -> RealSet:
    case = read_case(folder / section.text("case"))
    split = case.split
    if section.has("train") or section.has("test"):
        split = None
    if section.has("split"):
        split = guarded(section.place("split"), lambda: Split.parse(section.text("split")))
    how = case.preprocessing
    if section.has("cutoff_hz"):
        how = replace(how, filter=FILTERS.make("butterworth", {"cutoff_hz": section.number("cutoff_hz")}))
    how = replace(how, trim_s=section.number("trim_s", how.trim_s))
    train = texts(section, "train") or case.train
    test = texts(section, "test") or (() if section.has("split") else case.test)
    return RealSet(section.name("name"), replace(case, preprocessing=how), train, test, split)


def _figure(section: Section, names: Sequence[str]) -> Published:
    name = section.choice("set", names)
    values: tuple[float, ...] = ()
    if section.has("rmse_unfiltered"):
        stated = section.value("rmse_unfiltered")
        if not isinstance(stated, list):
            raise section.place("rmse_unfiltered").error("not a list", "write one number for each joint")
        values = tuple(float(v) for v in section.numbers("rmse_unfiltered", len(stated)))
    held_out, training = (section.number(key) if section.has(key) else None for key in ("test_error", "training_error"))
    return Published(
        name, section.text("who"), held_out, training, values, section.text("source"), section.text("remark", "")
    )


@dataclass(frozen=True)
class RealTask:
    """One method on one set."""

    name: str
    method: Method
    facts: Mapping[str, Any]

    @property
    def label(self) -> str:
        """What it is called in progress."""
        return f"{self.name}: {self.method.label}"


@dataclass(frozen=True, eq=False)
class RealWork:
    """Does the tasks of a scoreboard; the problem of the last set is kept in memory."""

    sets: Mapping[str, RealSet]

    def tasks(self, methods: Sequence[Method]) -> tuple[RealTask, ...]:
        """Return all tasks, those of one set beside each other; sets whose files are missing have none."""
        found = []
        for name, each in self.sets.items():
            if each.missing:
                continue
            common = _facts(each)
            for method in methods:
                part = method.part
                options = plain(asdict(part)) if is_dataclass(part) and not isinstance(part, type) else {}
                own = {"method": ESTIMATORS.name_of(part), "options": options}
                found.append(RealTask(name, method, {**common, **own}))
        return tuple(found)

    def result(self, task: RealTask) -> dict[str, Any]:
        """Return the figures of a task as plain data; a method or a log that fails is a result."""
        try:
            contest = _contest(self, task.name)
        except DynidentError as error:
            return failed(" ".join(str(error).split()), 0.0)
        figures = contest.attempt(task.method).figures()
        kept = {key: value for key, value in figures.items() if key not in ("values", "std", "options")}
        return {**kept, "parameters": contest.problem.base.count}


@lru_cache(maxsize=1)
def _contest(work: RealWork, name: str) -> Contest:
    """Return the problem of a set, which all methods are given."""
    each = work.sets[name]
    case = each.case
    train = [case.read(log) for log in each.train]
    test: list[Log] = [case.read(log) for log in each.test]
    if each.split is not None:
        parts = [each.split.apply(log) for log in train]
        train, test = [a for a, _ in parts], [b for _, b in parts]
    prior = read_prior(case.find(case.prior), case.robot, case.locked) if case.prior else None
    knowledge = PriorKnowledge(case.constraints, prior)
    problem = build_problem(
        case.model, train, case.preprocessing, choose_friction=case.choose_friction, knowledge=knowledge
    )
    contest = contest_of(problem, test)
    _ = contest.least
    return contest


def _facts(each: RealSet) -> dict[str, Any]:
    """Return what all tasks of a set depend on: the content of its files, its split and its preparation."""
    case = each.case
    files = {Path(file).name: sha256_of(file) for file in (case.path, case.robot_path) if Path(file).is_file()}
    logs = [[name, sha256_of(case.find(name))] for name in (*each.train, *each.test)]
    if not logs:
        raise DescriptionError(case.path, "train", "it names no log", "name logs in the case or in the scoreboard")
    return {
        "version": version("dynident"),
        "set": each.name,
        "files": files,
        "logs": logs,
        "trained": len(each.train),
        "split": None if each.split is None else repr(each.split),
        "preparation": plain(case.preprocessing.statement()),
    }
