"""compare: several estimators on the same logs of a case, measured by logs that had no part in the fit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from dynident.api.case_logs import CaseData, read_data
from dynident.api.case_options import cut, estimator_of, prior_of
from dynident.api.given_logs import LogLike, case_of, logs_of
from dynident.api.log_checks import check_logs, refuse_faulty, warn_of
from dynident.case.case import Case
from dynident.diagnosis.verdict import errors_in
from dynident.errors import BadArgument, BadOption
from dynident.identification.build_problem import PriorKnowledge, build_problem
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.problem.estimator import Estimator
from dynident.identification.search.box_search import BoxSearch
from dynident.model.threads import usable_processors
from dynident.studies.comparison.compare import compare as compare_methods
from dynident.studies.comparison.compare import contest_of
from dynident.studies.comparison.contest import Contest, Method, Outcome
from dynident.studies.comparison.truth import read_truth


def compare(
    case: Case | str | Path,
    estimators: str | Sequence[str] = "all",
    data: CaseData | tuple[LogLike | Sequence[LogLike], LogLike | Sequence[LogLike]] | None = None,
    truth: str | None = None,
    progress: Callable[[str], None] = lambda step: None,
    checks: bool = True,
    strict: bool = False,
) -> Iterator[Outcome]:
    """Yield what each estimator comes to on the logs of a case, once the log checks have looked at those that train.

    A finding that leaves a fit without a meaning stops it; any other one at error level is a Python warning.

    Args:
        case: The case, or its file.
        estimators: Names with their options, as :func:`methods_of` reads them, or a list of them.
        data: Logs to learn from and logs to test on, a pair, each as :func:`identify` takes them; None for those of
            the case.
        truth: File with the parameters of a simulated robot; None where they are not known.
        progress: Called with each step in words.
        checks: Make the log checks.
        strict: Raise after any finding at error level.

    Raises:
        BadArgument: Something else in place of the data.
        DynidentError: Any fault of the case, a log or an option.
        NotAccepted: The unit of the time or a column of a log makes no sense, or with ``strict`` any finding at error
            level.
    """
    case = case_of(case, learns=True)
    methods = methods_of(case, estimators if isinstance(estimators, str) else ",".join(estimators))
    data = read_data(case) if data is None else _data_of(data, case)
    if checks:
        quality = check_logs(case, data.train, progress)
        refuse_faulty(quality, strict)
        warn_of(errors_in(quality))
    contest = contest_of_case(case, data, truth=truth, progress=progress)
    yield from compare_methods(contest, methods, progress=progress)


def _data_of(given: object, case: Case) -> CaseData:
    """Return logs to learn from and to test on.

    Raises:
        BadArgument: No such pair, or something else in place of a log.
    """
    if isinstance(given, CaseData):
        return given
    if not isinstance(given, tuple | list) or len(given) != 2:
        evidence = f"{type(given).__name__} where logs to learn from and logs to test on are wanted"
        raise BadArgument("data", evidence, "write data=(train, test), each a log or a list of logs")
    train, test = (logs_of(each, case.robot, case.read, "data") for each in given)
    return CaseData(tuple(train), tuple(test))


def contest_of_case(
    case: Case, data: CaseData, truth: str | None = None, progress: Callable[[str], None] = lambda step: None
) -> Contest:
    """Return what every method is given, and what it is measured by.

    Args:
        case: The case.
        data: Logs to learn from and to test on.
        truth: File with the parameters of a simulated robot; None where they are not known.
        progress: Called with each step in words.

    Raises:
        DynidentError: Any fault of a log or of the truth.
    """
    knowledge = PriorKnowledge(case.constraints, prior_of(case))
    problem = build_problem(case.model, data.train, case.preprocessing, progress, case.choose_friction, knowledge)
    known = read_truth(case.find(truth), problem.model, case.locked) if truth else None
    return contest_of(problem, data.test, known)


def methods_of(case: Case, text: str, seed: int | None = None) -> list[Method]:
    """Return the methods that a text names, each once, in its order.

    Names are separated by commas; ``all`` is the whole family, those that solve at once first, those that simulate or
    search a box last; ``quick`` leaves these out. Options follow as ``:key=value``; a comma within a value
    stands before no letter, or in brackets. Options of the case's own estimator hold for its name.

    Args:
        case: Where the options of one estimator may stand.
        text: Such as ``all`` or ``wls,huber:bound=2,didim:kp=100,80:kd=9,7``.
        seed: For the methods that have one and do not state it.

    Raises:
        BadOption: An empty name, a negative seed or an option that a method does not have.
        UnknownChoice: No such estimator.
    """
    if seed is not None and seed < 0:
        raise BadOption("--seed", seed, "give 0 or more")
    found: dict[str, Method] = {}
    for written in split_names(text):
        for label in SETS[written]() if written in SETS else (written,):
            name, *settings = cut(label, ":")
            if not name:
                raise BadOption("--estimators", text, "write names with commas between them, such as wls,consistent")
            if name not in ESTIMATORS.names():
                ESTIMATORS.get(name)  # says which there are
            if not all("=" in setting for setting in settings):
                raise BadOption("--estimators", label, "write options behind a name, such as huber:bound=2")
            stated = [setting.partition("=")[0] for setting in settings]
            if seed is not None and "seed" not in stated and ESTIMATORS.has_option(name, "seed"):
                settings.append(f"seed={seed}")
            if not (case.bodies or case.estimator.options):
                settings[:0] = [f"{key}={value}" for key, value in ESTIMATORS.get(name).contest_options.items()]
            found.setdefault(label, Method(label, estimator_of(case, name, settings)))
    return list(found.values())


def jobs_that_pay(methods: Sequence[Method]) -> int:
    """Return how many methods to run side by side: one a processor, of those that take longer than a process to begin.

    These simulate or search a box.
    """
    return max(1, min(usable_processors(), sum(_work_of(type(method.part)) > 1 for method in methods)))


def _work_of(part: type[Estimator]) -> int:
    """Return how much work an estimator is: 0 from QR factors, 1 with the rows, 2 with simulations, 3 with a search."""
    if issubclass(part, BoxSearch):
        return 3
    return 2 if ".simulated." in part.__module__ else int(not part.from_triangles)


def _by_work() -> list[str]:
    return sorted(ESTIMATORS.names(), key=lambda name: _work_of(ESTIMATORS.get(name)))


#: Words for several estimators.
SETS: dict[str, Callable[[], list[str]]] = {
    "all": _by_work,
    "quick": lambda: [name for name in _by_work() if _work_of(ESTIMATORS.get(name)) < 2],
}


def split_names(text: str) -> list[str]:
    """Return the parts of a list whose items begin with a letter; a comma before anything else belongs to a value."""
    items: list[str] = []
    for piece in cut(text, ","):
        if items and ":" in items[-1] and not piece[:1].isalpha():
            items[-1] += f",{piece}"
        else:
            items.append(piece)
    return items
