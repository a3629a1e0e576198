"""An identification in one screen: verdict, test error by joint beside the robot model's, links, data, warnings."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from dynident.diagnosis.verdict import causes_against, quality_of
from dynident.identification.consistency.labels import IDENTIFIED, NOT_DETERMINED, ONLY_COMBINED, labels_of
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.plausibility import Plausibility
from dynident.identification.estimate.validation import Z_95, Validation
from dynident.results.nominal import LinkChange, errors_table, link_changes, missing_reason
from dynident.results.plausibility import plausibility_lines, plausible_words
from dynident.results.table_width import wrap_text
from dynident.results.text import (
    Table,
    columns_of,
    counted,
    format_number,
    format_percent,
    label,
    rest_words,
    shorten,
    total_error,
)

#: Share of a sum of parameters that base parameters may lack by rounding.
_SUM = 1e-6

#: Name of the finding of the log checks that friction is more than the parts of the model.
CURVE = "friction curve"

#: Joints and warnings that one screen has room for.
JOINTS, WARNINGS = 9, 4

#: Lines of a warning at most, one more on a screen of less than so many columns.
LINES, NARROW = 2, 120


def error_lines(estimate: Estimate, test: Validation | None) -> list[str]:
    """Return the error on unseen data, or on those of the training where there are none, and the nominal one."""
    data = estimate.train if test is None else test
    worst = max(data.joints, key=lambda fit: -1.0 if np.isnan(fit.relative_error) else fit.relative_error)
    of = f"{data.samples} samples; largest: {label(worst.name)} {format_percent(worst.relative_error)}"
    kind = "training error" if test is None else "test error"
    lines = [f"{label(estimate.model.robot.name)}: {kind} {total_error(data)} ({of})"]
    if test is None:
        lines.append("no test log: name one with --test, the training error is optimistic")
    elif not np.isclose(estimate.train.total_relative_error, test.total_relative_error, rtol=0.05):
        lines[0] += f"; training error {total_error(estimate.train)}"
    if words := rest_words(data):
        lines.append(f"the {kind} {words}{of_training(estimate.train, data)}")
    return lines


def of_training(train: Validation, data: Validation) -> str:
    """Return what the training error counts of the samples at rest, where it counts otherwise than that of ``data``."""
    words = rest_words(train)
    return f"; the training error {words}" if words and words != rest_words(data) else ""


def joints_table(estimate: Estimate, test: Validation | None) -> Table:
    """Return the relative error of each joint, nominal beside identified where the robot model has inertias.

    More joints than a screen has room for are cut to those with the largest error.
    """
    data = estimate.train if test is None else test
    table = errors_table(data)
    if not table.rows:
        errors = [(label(fit.name), format_percent(fit.relative_error, sign=False)) for fit in data.joints]
        rows: Sequence[tuple[str, ...]] = [*errors, ("total", format_percent(data.total_relative_error, sign=False))]
        table = Table(columns_of("joint", ">identified [%]"), tuple(rows))
    order = sorted(range(len(data.joints)), key=lambda k: -np.nan_to_num(data.joints[k].relative_error, nan=-1.0))
    kept = sorted(order[:JOINTS])
    left = len(data.joints) - len(kept)
    note = f"and {counted(left, 'joint')} with smaller errors" if left else ""
    return Table(table.columns, tuple(table.rows[k] for k in (*kept, len(table.rows) - 1)), note)


def summary_lines(estimate: Estimate, test: Validation | None, on_new: bool = False) -> list[str]:
    """Return what the estimate is made of: links, parameters, data, findings of the log checks.

    Of one that the log checks speak against links and parameters mean nothing: they are left out. Where the answer is
    about new logs (``on_new``) only the links and the checks are told, which `identify` told with the rest.
    """
    is_sound = not causes_against(estimate)
    if on_new:
        return list(filter(None, [bodies_line(estimate) if is_sound else "", checks_line(estimate)]))
    bodies = [
        bodies_line(estimate),
        *plausibility_lines(estimate, test),
        parameters_line(estimate),
        friction_line(estimate),
        rotors_line(estimate),
    ]
    known = [*(bodies if is_sound else []), data_line(estimate), checks_line(estimate)]
    return [line for line in (*known, missing_reason(estimate)) if line]


def friction_line(estimate: Estimate) -> str:
    """Return that intervals of friction count no error of its parts, where the log checks saw one; else empty."""
    found = [finding for log in quality_of(estimate) or () for finding in log["findings"]]
    joints = {name for each in found if each["name"] == CURVE for name in str(each["joint"]).split(", ")}
    if not joints:
        return ""
    return (
        f"friction of {counted(len(joints), 'joint')} is more than the parts of the model: intervals of Fc and Fv do "
        "not count that; friction: auto chooses further parts"
    )


def rotors_line(estimate: Estimate) -> str:
    """Return which rotor inertias stand beside one that the robot model states; empty where there are none."""
    beside = {one.name: -one.least for one in estimate.model.parameters if one.least < 0.0}
    if not beside:
        return ""
    stated = ", ".join(f"{label(name)} {value:.3g}" for name, value in beside.items())
    return f"rotor inertias are those beside what the robot model states, which may be less than 0: {stated}"


def bodies_line(estimate: Estimate) -> str:
    """Return whether the links are physically consistent and which mass is furthest from the robot model's.

    Of masses with an interval only those count whose interval does not hold the robot model's.
    """
    verdict = estimate.consistency
    if not verdict.consistent:
        more = len(verdict.reasons) - 1
        reasons = f"{'; '.join(verdict.reasons[:1])}{f' and {more} more' if more > 0 else ''}"
        return f"links: physically INCONSISTENT: {reasons}"
    facts = Plausibility.of(estimate.run)
    line = f"links: physically consistent{plausible_words(facts)}"
    changes = [each for each in link_changes(estimate) if min(each.mass) > 0]
    if not changes:
        return line
    widths = _mass_half_widths(estimate)
    told = [each for each in changes if each.mass_is != NOT_DETERMINED]
    totals = [sum(each.mass[k] for each in changes) for k in (0, 1)]
    half = total_mass_half_width(estimate)
    known = "(not determined by the data)" if half is None else f"(± {format_number(half, 2)}, 95 %)"
    whole = f"{format_number(totals[1], 3)} kg in all {known}, {format_number(totals[0], 3)} in the robot model"
    if not told:
        return f"{line}; {whole}"
    away = [each for each in told if not abs(each.mass[1] - each.mass[0]) <= widths.get(each.link, 0.0)]
    if not away:
        is_beyond = half is not None and abs(totals[1] - totals[0]) > half
        is_near = not any(one.is_relaxed and one.bound == "mass" for one in facts.contradicted) if facts else True
        return f"{line}; {whole}{_near_nominal(told, len(changes), is_beyond) if is_near else ''}"
    furthest = max(away, key=lambda each: abs(np.log(each.mass[1] / each.mass[0])))
    before, after = (format_number(mass, 3) for mass in furthest.mass)
    if furthest.link in widths:
        after += f" ± {format_number(widths[furthest.link], 2)}"
    return f"{line}; {whole}; furthest: {label(furthest.link)} {after} kg for {before} ({furthest.mass_is})"


def _near_nominal(told: Sequence[LinkChange], links: int, is_beyond: bool) -> str:
    """Return what is said of masses none of which is beyond its interval; ``is_beyond``: that of all links is."""
    if is_beyond:
        return ": beyond its interval, though no single link's mass is beyond its own"
    alone = sum(each.mass_is == IDENTIFIED for each in told)
    if not alone:
        return "; the data determine no mass of a link alone: they stay near the robot model's"
    some = "" if alone == links else f" of the {alone} that the data determine alone, of {counted(links, 'link')},"
    return f"; no mass of a link{some} differs from the robot model's beyond its 95 % interval"


def _mass_half_widths(estimate: Estimate) -> dict[str, float]:
    """Return half the 95 % interval of the mass of each link that has one, in kg, by its name."""
    if estimate.standard_deviations is None:
        return {}
    stds = estimate.standard_deviations[9 : 10 * len(estimate.model.robot.links) : 10]
    pairs = zip(estimate.model.robot.links, stds, strict=True)
    return {link.name: float(Z_95 * std) for link, std in pairs if np.isfinite(std) and std > 0}


def total_mass_half_width(estimate: Estimate) -> float | None:
    """Return half the 95 % interval of the mass of all links, in kg; None where no base parameters add up to it.

    A fixed base carries the first links: the torques of most arms determine other sums of masses than that of all.
    """
    matrix, wanted = estimate.base.matrix, np.zeros(len(estimate.base.parameters))
    wanted[9 : 10 * len(estimate.model.robot.links) : 10] = 1.0
    weights = np.linalg.lstsq(matrix.T, wanted, rcond=None)[0]
    if np.linalg.norm(matrix.T @ weights - wanted) > _SUM * np.linalg.norm(wanted):
        return None
    return float(Z_95 * np.sqrt(max(weights @ estimate.covariance @ weights, 0.0)))


def parameters_line(estimate: Estimate) -> str:
    """Return how many base parameters are significant, and how well the motion determines them."""
    lost = len(not_significant(estimate))
    count = estimate.base.count
    return (
        f"base parameters: {count - lost} of {count} significant at 95 %; "
        f"condition number {format_number(estimate.condition_number, 3)}"
    )


def not_significant(estimate: Estimate) -> list[int]:
    """Return the base parameters whose interval at 95 % holds zero, the least certain first."""
    holds_zero = ~(np.abs(estimate.beta) > estimate.half_widths())
    relative = np.where(np.isnan(estimate.relative_std), np.inf, estimate.relative_std)
    return [int(k) for k in np.argsort(-relative, kind="stable") if holds_zero[k]]


def data_line(estimate: Estimate) -> str:
    """Return samples, effective sample size and filter of the training."""
    told = [f"samples: {estimate.samples}"]
    if estimate.diagnostics is not None:
        told = [str(sentence) for sentence in estimate.diagnostics["verdicts"][:1]]
    facts = estimate.train.filter
    cutoff = facts.get("cutoff_hz")
    name = label(facts.get("kind", "none"))
    told.append(f"filter {name}" + (f" at {float(cutoff):.3g} Hz" if cutoff else ""))
    return "; ".join([*told, f"estimator {estimate.estimator}"])


def checks_line(estimate: Estimate) -> str:
    """Return what the log checks found, as counts and names."""
    quality = quality_of(estimate)
    if quality is None:
        return "log checks: not made"
    found = [finding for log in quality for finding in log["findings"]]
    told = []
    for severity in ("error", "warning", "note"):
        names = list(dict.fromkeys(str(each["name"]) for each in found if each["severity"] == severity))
        count = sum(each["severity"] == severity for each in found)
        if count:
            more = f" and {len(names) - 3} more" if len(names) > 3 else ""
            told.append(f"{counted(count, severity)} ({', '.join(names[:3])}{more})")
    return f"checks of the training logs: {'; '.join(told) or 'nothing found'}"


def warning_lines(warnings: Sequence[str], width: int) -> list[str]:
    """Return warnings of a few lines each, as many as a screen has room for; the last line counts the rest."""
    lines = [line for text in warnings[:WARNINGS] for line in _clauses(f"warning: {text}", width)]
    left = len(warnings) - WARNINGS
    return [*lines, f"and {counted(left, 'more warning')}"] if left > 0 else lines


def _clauses(text: str, width: int) -> list[str]:
    """Return as many whole clauses of a text as a few lines have room for: the first ones and the last.

    The last, behind a semicolon, says what to do: evidence between is left out first. A clause without room is cut.
    """
    room = LINES if width >= NARROW else LINES + 1
    ends = [(match.start(), match.end()) for match in re.finditer(r"[;:,] |\. | \(", text)]
    whole = [
        (start, end)
        for start, end in ends
        if start > len("warning: ") and text.count("(", 0, start) == text.count(")", 0, start)
    ]
    heads = [text[:start] for start, _ in whole]
    tails = [(start, text[end:]) for start, end in whole if text[start] == ";"]
    both = [f"{head} … {tail}" for head in heads for start, tail in tails if len(head) < start]
    for shown in (text, *sorted(both, key=len, reverse=True), *(f"{kept} …" for kept in reversed(heads))):
        lines = wrap_text(shown, width)
        if len(lines) <= room:
            return lines
    return [shorten(text, width)]


def labels_line(estimate: Estimate) -> str:
    """Return in one line how many standard parameters have which label; empty where there are none."""
    words = [label.word for label in labels_of(estimate)]
    counts = [f"{words.count(word)} {word}" for word in (IDENTIFIED, ONLY_COMBINED, NOT_DETERMINED)]
    source = estimate.run.prior
    return f"standard parameters: {', '.join(counts)}" + (f" ({source})" if source else "") if words else ""
