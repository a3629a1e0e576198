"""Who takes part in a Monte Carlo benchmark: methods, and the preparation of the log that each is given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from dynident.case.case_values import guarded, part_of
from dynident.data.preprocessing import FILTERS, Preprocessing
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.identification.estimators import ESTIMATORS, Estimator
from dynident.model.documents.numbers import Place
from dynident.model.documents.sections import Section
from dynident.simulation.controllers import Controller
from dynident.studies.comparison.contest import Method

#: Cut-off of an unfiltered preparation as a share of its samples a second: differences need one, this is beyond.
OPEN = 0.4

#: What the estimators call that which a controller feeds forward.
_FEEDS = {"none": "none", "gravity": "gravity", "model": "computed"}


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
        """Return the preprocessing of a condition with ``rate`` samples a second, in Hz."""
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


def entrants_of(top: Section, section: Section, controllers: Sequence[Controller]) -> tuple[Entrant, ...]:
    """Return who takes part.

    Args:
        top: The benchmark.
        section: It, or its short form, where the key ``methods`` stands.
        controllers: Those of the cells that logs are made in, each once.

    Raises:
        DescriptionError: A fault, with the key.
    """
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
            found.append(Entrant(_method(place, *part_of(place, item), controllers), preparation))
    return tuple(found)


def _method(place: Place, name: str, options: dict[str, str | None], controllers: Sequence[Controller]) -> Method:
    """Return a method; the option ``controller: known`` tells it the controller that the logs were made with."""
    known = options.pop("controller", "unknown")
    label = ":".join([name, *(f"{key}={text}" for key, text in options.items())])
    if known not in ("known", "unknown"):
        raise place.error(f"controller: {known}", "write controller: known, or leave it out")
    if known == "known":
        options, label = {**options, **_told(place, controllers)}, f"{label} with controller"
    return Method(label, guarded(place, lambda: _entrant(name, options)))


def _entrant(name: str, options: Mapping[str, str | None]) -> Estimator:
    return ESTIMATORS.make_from_text(name, {**ESTIMATORS.get(name).contest_options, **options})


def _told(place: Place, controllers: Sequence[Controller]) -> dict[str, str]:
    """Return the options that tell an estimator of the one controller of all cells, as text."""
    first = controllers[0] if len(controllers) == 1 else None
    known = None if first is None else first.plain_gains()
    if first is None or known is None:
        step = "state one for all robots and levels: cell: controller: pd, with stiffness and damping, joint by joint"
        raise place.error("controller: known without a plain pd controller and its gains", step)
    words = {
        key: ",".join(f"{float(gain)!r}" for gain in values) for key, values in zip(("kp", "kd"), known, strict=True)
    }
    return {**words, "feedforward": _FEEDS[first.feedforward]}


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
