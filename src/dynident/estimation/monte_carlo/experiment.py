"""The plan of a Monte Carlo benchmark, and its file: robots, motions, noise, preparations and who takes part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from dynident.errors import BadOption, DescriptionError, UnknownChoice
from dynident.estimation.comparison.contest import Method
from dynident.estimation.estimators import ESTIMATORS
from dynident.estimation.monte_carlo.virtual_run import Recording
from dynident.experiment.case_file.case import DEFAULT_FRICTION, read_case
from dynident.experiment.case_file.case_values import guarded, part_of, texts
from dynident.experiment.preprocessing import FILTERS, Preprocessing
from dynident.experiment.preprocessing.butterworth import Butterworth
from dynident.files import unreadable
from dynident.model.documents.numbers import Place
from dynident.model.documents.sections import Section
from dynident.model.documents.strict_yaml import load_yaml
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION

FORMAT = 1

#: Cut-off of an unfiltered preparation as a share of its rows a second: differences need one, and this is beyond them.
OPEN = 0.4

_KEYS = (
    "benchmark", "title", "source", "robots", "friction", "coefficients", "motion", "truth", "duration_s", "rates_hz",
    "recording", "noise", "draws", "guess", "seed", "preparations", "methods", "quick",
)  # fmt: skip
_QUICK = ("draws", "rates_hz", "noise", "methods")


@dataclass(frozen=True)
class NoiseLevel:
    """Noise of one condition: standard deviations of the encoders in rad or m, of the torques in N m or N."""

    name: str
    position: float
    torque: float


@dataclass(frozen=True)
class Preparation:
    """How a log becomes rows.

    Attributes:
        name: What methods that are given it show beside their own names; empty for the only one.
        how: Filter, trim and standstill; the rate is that of the condition.
        unfiltered: Rows are taken first and differenced as they are; the filter does not count.
    """

    name: str
    how: Preprocessing
    unfiltered: bool = False

    def at(self, rate: float) -> Preprocessing:
        """Return the preprocessing of a condition with ``rate`` rows a second, in Hz."""
        if not self.unfiltered:
            return replace(self.how, rate_hz=rate)
        return replace(self.how, filter=Butterworth(OPEN * rate), rate_hz=None)


@dataclass(frozen=True)
class Entrant:
    """A method with the preparation that it is given."""

    method: Method
    preparation: Preparation

    @property
    def label(self) -> str:
        """What it is called in tables."""
        name = self.preparation.name
        return f"{self.method.label} ({name})" if name else self.method.label


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
        coefficients: True values of drive coefficients by symbol, one a joint, in place of those that are invented.
        motion: Where motions come from.
        truth: ``description``, or ``random``: each draw has a robot of its own.
        duration: Of a log, in s.
        rates: Rows a second that are used, in Hz.
        recording: Rates and controller of the virtual robot; its noise is that of the condition.
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
    coefficients: Mapping[str, tuple[float, ...]]
    motion: MotionPlan
    truth: str
    duration: float
    rates: tuple[float, ...]
    recording: Recording
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


def shipped_benchmarks() -> tuple[str, ...]:
    """Return the names of the configurations that ship."""
    folder = files("dynident.estimation.monte_carlo") / "configurations"
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
    try:
        data = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    value, lines = load_yaml(path, data)
    top = Section.top(path, value, _KEYS, lines)
    if top.text("benchmark") != str(FORMAT):
        raise top.place("benchmark").error(f"format {top.text('benchmark')}", f"this version reads format {FORMAT}")
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
    return Path(str(files("dynident.estimation.monte_carlo") / "configurations" / f"{name}.yaml"))


def _kept(entrants: tuple[Entrant, ...], wanted: Sequence[str]) -> tuple[Entrant, ...]:
    """Return the entrants that are named by their label, or by the label of their method in every preparation."""
    known = [*(entrant.label for entrant in entrants), *(entrant.method.label for entrant in entrants)]
    for name in wanted:
        if name not in known:
            raise UnknownChoice("method of this benchmark", name, tuple(dict.fromkeys(known)))
    return tuple(each for each in entrants if each.label in wanted or each.method.label in wanted)


def _experiment(path: Path, top: Section, short: Section | None) -> Experiment:
    def of(key: str) -> Section:
        return short if short is not None and short.has(key) else top

    recording = _recording(top.section("recording", ("rate_hz", "control_hz", "kp", "kd")))
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
    models = _models(path, top)
    return guarded(
        top.place(),
        lambda: Experiment(
            title=top.text("title", path.stem),
            source=top.text("source", ""),
            models=models,
            coefficients=_coefficients(top, models),
            motion=plan,
            truth=top.choice("truth", ("description", "random"), "description"),
            duration=top.number("duration_s", 10.0),
            rates=_numbers(of("rates_hz"), "rates_hz", (200.0,)),
            recording=recording,
            noise=_noise(of("noise"), top),
            draws=int(of("draws").number("draws", 10)),
            guess=top.number("guess") if top.has("guess") else None,
            seed=int(top.number("seed", 0)),
            entrants=_entrants(top, of("methods"), recording),
            path=path,
        ),
    )


def _numbers(section: Section, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
    value = section.value(key) if section.has(key) else None
    if value is None:
        return default
    count = len(value) if isinstance(value, list) else 0
    return tuple(float(number) for number in section.numbers(key, count))


def _models(path: Path, top: Section) -> dict[str, DynamicModel]:
    """Return the robots by name; a case brings its own friction, a description takes that of the benchmark."""
    names = texts(top, "robots")
    if not names:
        raise top.place("robots").error("no robot", "name at least one robot or case file")
    found = {}
    for name in names:
        beside = path.parent / name
        case = read_case(beside if beside.is_file() else name)
        friction = case.friction
        if top.has("friction") and not case.path:
            friction = _friction(top)
        found[case.robot.name] = DynamicModel(case.robot, friction)
    return found


def _coefficients(top: Section, models: Mapping[str, DynamicModel]) -> dict[str, tuple[float, ...]]:
    """Return the values of drive coefficients, which every robot must have at every joint."""
    if not top.has("coefficients"):
        return {}
    symbols = dict.fromkeys(p.symbol for model in models.values() for p in model.parameters[model.inertial_count :])
    section = top.section("coefficients", tuple(symbols))
    counts = {model.robot.dof for model in models.values()}
    if len(counts) > 1:
        raise top.place("coefficients").error("for robots with different numbers of joints", "benchmark them apart")
    (count,) = counts
    return {name: tuple(float(v) for v in section.numbers(name, count)) for name in symbols if section.has(name)}


def _friction(top: Section) -> tuple[Any, ...]:
    value = top.value("friction")
    place = top.place("friction")
    if not isinstance(value, list):
        raise place.error("not a list", f"write a list such as [{', '.join(DEFAULT_FRICTION)}]")
    return tuple(guarded(place, lambda item=item: FRICTION.make_from_text(*part_of(place, item))) for item in value)


def _noise(section: Section, top: Section) -> tuple[NoiseLevel, ...]:
    """Return the levels; a short form names some of those of the whole."""
    levels = tuple(
        NoiseLevel(each.name("name"), each.at_least_zero("position"), each.at_least_zero("torque"))
        for each in top.sections("noise", ("name", "position", "torque"))
    )
    if section is top:
        return levels
    wanted, known = texts(section, "noise"), {level.name: level for level in levels}
    for name in wanted:
        if name not in known:
            raise section.place("noise").error(f"no noise '{name}'", f"name some of: {', '.join(known)}")
    return tuple(known[name] for name in wanted)


def _recording(section: Section) -> Recording:
    gains: dict[str, tuple[float, ...] | None] = {"kp": None, "kd": None}
    for name in gains:
        value = section.value(name) if section.has(name) else None
        if isinstance(value, list):
            gains[name] = tuple(float(number) for number in section.numbers(name, len(value)))
        elif value is not None:
            raise section.place(name).error("not a list", "write one number for each joint")
    if (gains["kp"] is None) != (gains["kd"] is None):
        raise section.place("kp").error("one of kp and kd without the other", "state both, or none")
    rates = (section.number("rate_hz", 1000.0), section.number("control_hz", 1000.0))
    return Recording(*rates, stiffness=gains["kp"], damping=gains["kd"])


def _entrants(top: Section, section: Section, recording: Recording) -> tuple[Entrant, ...]:
    preparations = _preparations(top)
    asked = section.section("methods", tuple(preparations))
    found = []
    for name, preparation in preparations.items():
        if not asked.has(name):
            continue
        value, place = asked.value(name), asked.place(name)
        if not isinstance(value, list):
            raise place.error("not a list", "write a list of estimators, such as [ols, wls]")
        for item in value:
            found.append(Entrant(_method(place, *part_of(place, item), recording), preparation))
    return tuple(found)


def _method(place: Place, name: str, options: dict[str, str | None], recording: Recording) -> Method:
    """Return a method; the option ``controller: known`` tells it the controller that the logs were made with."""
    known = options.pop("controller", "unknown")
    label = ":".join([name, *(f"{key}={text}" for key, text in options.items())])
    if known not in ("known", "unknown"):
        raise place.error(f"controller: {known}", "write controller: known, or leave it out")
    if known == "known":
        if recording.stiffness is None or recording.damping is None:
            raise place.error("controller: known without its gains", "state kp and kd under recording")
        gains = {"kp": recording.stiffness, "kd": recording.damping}
        texts_of = {key: ",".join(f"{gain!r}" for gain in values) for key, values in gains.items()}
        options, label = {**options, **texts_of, "feedforward": "gravity"}, f"{label} with controller"
    return Method(label, guarded(place, lambda: ESTIMATORS.make_from_text(name, options)))


def _preparations(top: Section) -> dict[str, Preparation]:
    value = top.value("preparations")
    if not isinstance(value, dict) or not value:
        raise top.place("preparations").error("no preparation", "state at least one, such as filtered: {...}")
    section, found = top.section("preparations", tuple(value)), {}
    for name in value:
        each = section.section(name, ("filter", "unfiltered", "trim_s", "standstill"))
        place, part = each.place("filter"), FILTERS.make("butterworth")
        if each.has("filter"):
            item = part_of(place, each.value("filter"))
            part = guarded(place, lambda item=item: FILTERS.make_from_text(*item))
        how = Preprocessing(
            part, trim_s=each.number("trim_s", 0.1), standstill=each.number("standstill", 0.0), rest="keep"
        )
        unfiltered = each.has("unfiltered") and each.choice("unfiltered", ("true", "false")) == "true"
        found[name] = Preparation(name if len(value) > 1 else "", how, unfiltered)
    return found
