"""The plan of a Monte Carlo benchmark, and its file: robots, motions, noise, preparations and who takes part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from dynident.case.case import Case, read_case
from dynident.case.case_values import guarded, part_of, texts
from dynident.case.cell_section import KEYS as CELL_KEYS
from dynident.case.cell_section import CellSetup, cell_of
from dynident.errors import BadOption, DescriptionError, UnknownChoice
from dynident.file_versions import FileVersions
from dynident.files import bytes_of
from dynident.model.documents.numbers import Place
from dynident.model.documents.sections import Section
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, default_friction
from dynident.robot_files.strict_yaml import load_yaml
from dynident.simulation.truth import true_parameters
from dynident.studies.benchmark.entrants import Entrant, entrants_of

VERSIONS = FileVersions("a benchmark", key="benchmark")

_KEYS = (
    "benchmark", "title", "source", "robots", "friction", "motion", "truth", "cell", "duration_s", "rates_hz",
    "noise", "draws", "guess", "seed", "preparations", "methods", "quick",
)  # fmt: skip
_NOISE = ("name", "position", "torque", "set")
_QUICK = ("draws", "rates_hz", "noise", "methods")


@dataclass(frozen=True)
class NoiseLevel:
    """What the cell has beside its own settings in one condition.

    Attributes:
        name: What it is called.
        position: Standard deviation of the encoders, in rad or m.
        torque: Standard deviation of the measured torques, in N m or N.
        settings: Other settings of the cell, such as ``ripple.amplitude=0.3``.
    """

    name: str
    position: float
    torque: float
    settings: tuple[str, ...] = ()

    def cell(self, setup: CellSetup) -> CellSetup:
        """Return a cell in this condition."""
        noise = (f"encoder.noise={self.position!r}", f"effort.noise={self.torque!r}")
        return setup.changed((*noise, *self.settings))


@dataclass(frozen=True)
class MotionPlan:
    """Where the motions come from.

    Attributes:
        train: Plan file of the recorded motion; empty for a designed one.
        test: Plan file of the motion on which torques are compared; empty for a designed one.
        period: Of designed ones, in s.
        harmonics: Of designed ones.
        starts: Of their search.
        time_limit: Of their search, in s.
    """

    train: str = ""
    test: str = ""
    period: float = 10.0
    harmonics: int = 5
    starts: int = 2
    time_limit: float = 30.0


@dataclass(frozen=True)
class Experiment:
    """Everything that a benchmark does.

    Attributes:
        title: Of its page.
        source: Where its conditions come from.
        models: Robots by name, with friction and nominal bodies.
        cells: The virtual cell of each robot; noise is that of the condition.
        motion: Where motions come from.
        truth: ``nominal``, or ``random``: each draw has a robot of its own.
        duration: Of a log, in s.
        rates: Samples a second that are used, in Hz.
        noise: Levels.
        draws: Logs of each condition, each with noise and guess of its own.
        guess: Relative deviation of the bodies and friction that methods are told; None: they are told none.
        seed: Of all draws.
        entrants: Who takes part.
        path: The file; its folder is where its plans are looked for.
    """

    title: str
    source: str
    models: Mapping[str, DynamicModel]
    cells: Mapping[str, CellSetup]
    motion: MotionPlan
    truth: str
    duration: float
    rates: tuple[float, ...]
    noise: tuple[NoiseLevel, ...]
    draws: int
    guess: float | None
    seed: int
    entrants: tuple[Entrant, ...]
    path: Path = field(default_factory=Path)

    def __post_init__(self) -> None:
        for name, value in (
            ("draws", self.draws),
            ("duration_s", self.duration),
            *(("rates_hz", r) for r in self.rates),
        ):
            if not value > 0:
                raise BadOption(name, value, "give a number above 0")
        if self.guess is not None and not 0 <= self.guess < 1:
            raise BadOption("guess", self.guess, "give a relative deviation from 0 to less than 1, such as 0.15")
        for what, found in (("noise", self.noise), ("methods", self.entrants)):
            names = [each.name if isinstance(each, NoiseLevel) else each.label for each in found]
            if not names or len(set(names)) != len(names):
                raise BadOption(what, names, "give at least one, each once")

    def cell(self, robot: str, noise: NoiseLevel) -> CellSetup:
        """Return the cell of a robot in a condition."""
        return noise.cell(self.cells[robot])


def shipped_benchmarks() -> tuple[str, ...]:
    """Return the names of the configurations that ship."""
    folder = files("dynident.studies.benchmark") / "configurations"
    return tuple(sorted(entry.name.removesuffix(".yaml") for entry in folder.iterdir() if entry.name.endswith(".yaml")))


def read_experiment(
    name: str, *, quick: bool = False, draws: int | None = None, methods: Sequence[str] | None = None
) -> Experiment:
    """Read a benchmark by the name of one that ships, or from a file; docs/benchmark.md has every key.

    Args:
        name: Name or path.
        quick: The short form that the file states.
        draws: In place of those of the file.
        methods: Labels of the entrants that are kept, or names of estimators; None keeps all.

    Raises:
        BadOption: A number that cannot be.
        DescriptionError: A fault in the file, with the key.
        FileError: No such file.
        UnknownChoice: No benchmark, estimator, filter or friction of this name.
    """
    path = _path(name)
    value, lines = load_yaml(path, bytes_of(path))
    top = Section.versioned(path, value, _KEYS, lines, VERSIONS)
    short = top.section("quick", _QUICK)
    if quick and not top.has("quick"):
        raise DescriptionError(path, "quick", "it states no short form", "run it without --quick, or with --draws 1")
    found = _experiment(path, top, short if quick else None)
    if draws is not None:
        found = replace(found, draws=draws)
    return found if methods is None else replace(found, entrants=_kept(found.entrants, methods))


def _path(name: str) -> Path:
    given = Path(name)
    if given.suffix.lower() in (".yaml", ".yml") or given.is_file():
        return given
    known = shipped_benchmarks()
    if name not in known:
        raise UnknownChoice("benchmark", name, known)
    return Path(str(files("dynident.studies.benchmark") / "configurations" / f"{name}.yaml"))


def _kept(entrants: tuple[Entrant, ...], wanted: Sequence[str]) -> tuple[Entrant, ...]:
    """Return the entrants that are named by their label, or by the label of their method in every preparation."""
    known = [*(entrant.label for entrant in entrants), *(entrant.method.label for entrant in entrants)]
    for name in wanted:
        if name not in known:
            raise UnknownChoice("method of this benchmark", name, tuple(dict.fromkeys(known)))
    return tuple(each for each in entrants if each.label in wanted or each.method.label in wanted)


#: Words of ``truth``, and what files of before called it.
_TRUTHS = {"nominal": "nominal", "random": "random", "description": "nominal"}


def _experiment(path: Path, top: Section, short: Section | None) -> Experiment:
    def of(key: str) -> Section:
        return short if short is not None and short.has(key) else top

    motion = top.section("motion", ("train", "test", "period_s", "harmonics", "starts", "time_limit_s"))
    stated = MotionPlan()
    plan = MotionPlan(
        motion.text("train", ""),
        motion.text("test", ""),
        motion.number("period_s", stated.period),
        int(motion.number("harmonics", stated.harmonics)),
        int(motion.number("starts", stated.starts)),
        motion.number("time_limit_s", stated.time_limit),
    )
    cases = _cases(path, top)
    friction = _friction(top) if top.has("friction") else None
    models = {
        name: DynamicModel(case.robot, friction if friction is not None and not case.path else case.friction)
        for name, case in cases.items()
    }
    stated = cell_of(top.section("cell", CELL_KEYS)) if top.has("cell") else None
    cells = {name: stated or case.cell or CellSetup(path=str(path)) for name, case in cases.items()}
    noise = _noise(of("noise"), top)
    changed = [(name, _changed(setup, level, top)) for level in noise for name, setup in cells.items()]
    for name, setup in changed:
        _check_truth(models[name], setup, top.place("cell"))
    controllers = tuple(dict.fromkeys(setup.cell.controller for _, setup in changed))
    return guarded(
        top.place(),
        lambda: Experiment(
            title=top.text("title", path.stem),
            source=top.text("source", ""),
            models=models,
            cells=cells,
            motion=plan,
            truth=_TRUTHS[top.choice("truth", tuple(_TRUTHS), "nominal")],
            duration=top.number("duration_s", 10.0),
            rates=_numbers(of("rates_hz"), "rates_hz", (200.0,)),
            noise=noise,
            draws=int(of("draws").number("draws", 10)),
            guess=top.number("guess") if top.has("guess") else None,
            seed=int(top.number("seed", 0)),
            entrants=entrants_of(top, of("methods"), controllers),
            path=path,
        ),
    )


def _numbers(section: Section, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
    value = section.value(key) if section.has(key) else None
    if value is None:
        return default
    count = len(value) if isinstance(value, list) else 0
    return tuple(float(number) for number in section.numbers(key, count))


def _cases(path: Path, top: Section) -> dict[str, Case]:
    """Return the robots by name as cases; a case brings its own friction and cell, a description neither."""
    names = texts(top, "robots")
    if not names:
        raise top.place("robots").error("no robot", "name at least one robot or case file")
    found = {}
    for name in names:
        beside = path.parent / name
        case = read_case(beside if beside.is_file() else name)
        if case.robot.name in found:
            raise top.place("robots").error(f"two robots called '{case.robot.name}'", "benchmark them apart")
        found[case.robot.name] = case
    return found


def _check_truth(model: DynamicModel, setup: CellSetup, place: Place) -> None:
    """Refuse words of a cell on the truth that do not fit the robot, or that a benchmark has words of its own for."""
    truth = setup.truth
    if truth.parameters != "nominal" or truth.believed != "truth":
        step = "a benchmark's truth is that of its key 'truth'; its controllers believe it"
        raise place.error("truth: parameters or believed", step)
    guarded(place, lambda: true_parameters(model, np.zeros(len(model.parameters)), replace(truth, spread=0.0)))


def _friction(top: Section) -> tuple[Any, ...]:
    value = top.value("friction")
    place = top.place("friction")
    if not isinstance(value, list):
        raise place.error("not a list", f"write a list such as [{', '.join(default_friction())}]")
    return tuple(guarded(place, lambda item=item: FRICTION.make_from_text(*part_of(place, item))) for item in value)


def _changed(setup: CellSetup, level: NoiseLevel, top: Section) -> CellSetup:
    """Return a cell in a condition; a fault of its settings stands where they stand in the file."""
    names = [each.text("name") for each in top.sections("noise", _NOISE)]
    place = top.place(f"noise.{names.index(level.name) + 1}" + (".set" if level.settings else ""))
    try:
        return guarded(place, lambda: level.cell(setup))
    except DescriptionError as error:
        if error.where == place.where:
            raise
        raise DescriptionError(place.path, place.where, f"{error.where}: {error.evidence}", error.step) from error


def _noise(section: Section, top: Section) -> tuple[NoiseLevel, ...]:
    """Return the levels; a short form names some of those of the whole."""
    levels = tuple(
        NoiseLevel(
            each.name("name"), each.at_least_zero("position"), each.at_least_zero("torque"), tuple(texts(each, "set"))
        )
        for each in top.sections("noise", _NOISE)
    )
    if section is top:
        return levels
    wanted, known = texts(section, "noise"), {level.name: level for level in levels}
    for name in wanted:
        if name not in known:
            raise section.place("noise").error(f"no noise '{name}'", f"name some of: {', '.join(known)}")
    return tuple(known[name] for name in wanted)
