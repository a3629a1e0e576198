"""A case with other choices in place of its own, as a person writes them, and the parts that it names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from dynident.case.case import Case, read_case
from dynident.case.part_sections import AUTO
from dynident.data.preprocessing import FILTERS, default_preprocessing
from dynident.data.split import Split
from dynident.errors import BadOption, DescriptionError, DynidentError
from dynident.identification.estimators import ESTIMATORS, Estimator
from dynident.model.friction import FRICTION, auto_friction, default_friction

if TYPE_CHECKING:
    from dynident.identification.problem.prior import BodyPrior


@dataclass(frozen=True)
class CaseOptions:
    """What takes the place of what a case states; empty or None leaves it as stated.

    Attributes:
        friction: Names of friction parts, or ``auto`` alone.
        split: How one log becomes a training and a test part, such as ``first:0.67``.
        has_test_logs: Whether test logs are given, which take the place of the case's split.
        cutoff: Cut-off of the Butterworth filter in Hz, or ``auto``.
        rate: Samples a second, ``all`` or ``auto``.
        delay: Seconds by which torques lag behind positions, or ``auto``.
        prior: File with inertias known beforehand.
        constraints: File with constraints.
        bodies: ``free``, ``plausible`` or ``auto``.
    """

    friction: tuple[str, ...] = ()
    split: str | None = None
    has_test_logs: bool = False
    cutoff: str | None = None
    rate: str | None = None
    delay: str | None = None
    prior: str | None = None
    constraints: str | None = None
    bodies: str | None = None


def case_with(path: str, options: CaseOptions, open_gains: bool = False) -> Case:
    """Return the case of a file, or of a robot model, with other choices in place of its own.

    Args:
        path: Case file or robot model.
        options: The other choices.
        open_gains: Read a case that still asks for drive gains, as one without them.

    Raises:
        DynidentError: Any fault of the case or of an option.
    """
    case = read_case(path, open_gains, options.friction)
    if options.split and options.has_test_logs:
        raise BadOption("--split", options.split, "it does not go with --test; give one of the two")
    if options.split or options.has_test_logs:
        case = replace(case, split=Split.parse(options.split) if options.split else None)
    if options.bodies:
        case = replace(case, bodies=options.bodies)
    return with_knowledge(_with_preprocessing(case, options), options.prior, options.constraints)


def with_drive_friction(case: Case) -> Case:
    """Return the case of a robot model alone with Coulomb friction, viscous friction, offset and rotor inertia.

    Held-out samples decide on rotor inertia and on the width of the sign, as in drafts. A case file stays as it is.
    """
    if case.path:
        return case
    names = {*default_friction(), "rotor_inertia"}
    own = tuple(part for part in auto_friction(case.robot) if FRICTION.name_of(part) in names)
    return replace(case, friction=own)


def _with_preprocessing(case: Case, options: CaseOptions) -> Case:
    preprocessing = case.preprocessing
    if options.cutoff is not None:
        filter = FILTERS.make_from_text("butterworth", {"cutoff_hz": options.cutoff})
        preprocessing = replace(preprocessing, filter=filter)
    if options.rate is not None:
        try:
            rate = None if options.rate in ("all", AUTO) else float(options.rate)
            rows = default_preprocessing().rows_per_period if options.rate == AUTO else None
            preprocessing = replace(preprocessing, rate_hz=rate, rows_per_period=rows)
        except ValueError:
            raise BadOption("rate", options.rate, "give samples a second, 'all' or 'auto'") from None
    if options.delay is not None:
        try:
            delay = None if options.delay == AUTO else float(options.delay)
            preprocessing = replace(preprocessing, delay_s=delay)
        except ValueError:
            raise BadOption("delay", options.delay, "give seconds, or 'auto'") from None
    return replace(case, preprocessing=preprocessing)


def with_knowledge(case: Case, prior: str | None, constraints: str | None) -> Case:
    """Return the case with a prior and constraints from files in place of its own.

    Raises:
        DynidentError: A fault of the constraints file.
    """
    from dynident.case.constraints_file import read_constraints  # few cases need it

    if prior:
        case = replace(case, prior=prior)
    return (
        replace(case, constraints=read_constraints(constraints, case.robot, case.robot_path)) if constraints else case
    )


def prior_of(case: Case) -> BodyPrior | None:
    """Return the prior that a case names, read; None where it names none.

    Raises:
        DynidentError: The file is no robot model or estimate, or of another robot.
    """
    if not case.prior:
        return None
    from dynident.case.prior_file import read_prior  # few cases need it

    return read_prior(case.find(case.prior), case.robot, case.locked)


def estimator_of(case: Case, name: str | None = None, options: Sequence[str] = ()) -> Estimator:
    """Return the estimator of a case, or the named one, with ``key=value`` options, also behind the name with colons.

    Args:
        case: The case; options of its own estimator hold where that is named.
        name: Such as ``huber`` or ``huber:bound=2``; None for that of the case.
        options: Such as ``iterations=500``.

    Raises:
        UnknownChoice: No such estimator.
        BadOption: No such option, or not of the form key=value.
    """
    chosen = case.estimator
    written: list[str] = []
    if name is not None:
        name, *written = cut(name, ":")
    texts: dict[str, str | None] = dict(chosen.options) if name in (None, chosen.name) else {}
    for item in (*written, *options):
        key, equals, value = item.partition("=")
        if not equals:
            raise BadOption("--option", item, "write key=value, such as --option iterations=500")
        texts[key] = value
    try:
        if case.bodies and ESTIMATORS.has_option(name or chosen.name, "bodies"):
            texts.setdefault("bodies", case.bodies)
        return ESTIMATORS.make_from_text(name or chosen.name, texts)
    except DynidentError as error:
        if name is None and case.path and not options:
            raise DescriptionError(case.path, "estimator", str(error), "see docs/case-file.md") from error
        raise


def cut(text: str, mark: str) -> list[str]:
    """Return the text cut at a mark outside brackets, blanks around the parts left out."""
    parts, depth = [""], 0
    for character in text:
        depth += (character in "[(") - (character in ")]")
        if character == mark and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return [part.strip() for part in parts]
