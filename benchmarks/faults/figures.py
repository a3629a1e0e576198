"""Whether a finding states the direction and the figure of a fault.

A figure is right within 5 %, or inside a stated 95 % interval whose half is at most 10 % of it. Figures of scales and
clocks are factors; besides, these must be off one on the right side. A direction of gravity is right where its distance
from the true one is that share of what the stated one is off. Signs and orders are right where the edit that is asked
for gives the log without the fault back. What the clean log says already is a part of the right figure. A figure whose
interval is wider and holds the right one is no figure, and not false; one beside its interval is false.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.faults.kinds import Wanted
from benchmarks.faults.remedies import EDITS, told
from benchmarks.faults.trials import Trial
from dynident.arrays import Array
from dynident.data.formats._units import QUANTITY
from dynident.diagnosis.checks.base import CheckedLog
from dynident.diagnosis.checks.torque_scale import against_known, against_nominal
from dynident.diagnosis.finding import Finding

#: Error of a figure, and half of a stated interval that holds the right one, as shares of it.
EXACT, WIDE = 0.05, 0.1

#: Values are told with three digits.
PRINTED = 5e-3


@dataclass(frozen=True)
class Stated:
    """What a finding states: a value, complex where it has a phase, or a vector, half of its interval, what it is off.

    Attributes:
        value: A number, a complex number or a vector.
        half: Half of the 95 % interval; 0 where none is stated.
        nothing: The value without a fault: 0, 1 of a factor, the stated gravity of a gravity.
    """

    value: complex | np.ndarray
    half: float = 0.0
    nothing: complex | np.ndarray = 0.0

    def grade(self, wanted: complex | np.ndarray) -> str:
        """Return ``exact`` where it is near the right one or a narrow interval holds that, else ``wide`` or ``false``.

        A factor on the wrong side of one is false.
        """
        away, error = (float(np.linalg.norm(np.atleast_1d(wanted - each))) for each in (self.nothing, self.value))
        if self.is_factor:
            if (np.real(self.value) - 1.0) * (np.real(wanted) - 1.0) < 0.0:
                return "false"
            away = abs(wanted)
        if error <= (EXACT + PRINTED) * away or (self.half <= WIDE * away and error <= self.half):
            return "exact"
        return "wide" if error <= self.half else "false"

    @property
    def is_narrow(self) -> bool:
        """Whether half of the interval is a small share of what is told."""
        size = self.value if self.is_factor else self.value - self.nothing
        return self.half <= WIDE * float(np.linalg.norm(np.atleast_1d(size)))

    @property
    def is_factor(self) -> bool:
        """Whether the value is a factor, 1 without a fault."""
        return np.ndim(self.value) == 0 and self.nothing == 1.0


def stated(finding: Finding, trial: Trial) -> Stated | None:
    """Return what a finding states; None where it states no figure."""
    read = _READ.get(finding.name)
    return None if read is None else read(finding, trial)


def _clock(finding: Finding, trial: Trial) -> Stated:
    if "ratio" in finding.numbers:  # dq over the derivative of q
        return Stated(finding.numbers["ratio"], 0.0, 1.0)
    return Stated(1.0 + finding.numbers["value"], finding.numbers["half_width"], 1.0)


def _scale(finding: Finding, trial: Trial) -> Stated:
    numbers = finding.numbers
    if "factor" in numbers:  # what undoes it
        return Stated(1.0 / numbers["factor"], (1.0 / numbers["low"] - 1.0 / numbers["high"]) / 2.0, 1.0)
    return Stated(1.0 + numbers["value"], numbers["half_width"], 1.0)


def _gravity(finding: Finding, trial: Trial) -> Stated:
    gravity, size = np.asarray(trial.case.robot.gravity), float(np.linalg.norm(trial.case.robot.gravity))
    spread = re.search(r"\+- (\S+) degrees", finding.evidence)
    half = size * np.radians(float(spread[1])) if spread else 0.0
    return Stated(np.array(told(finding, "gravity"), dtype=float), half, gravity)


def _load(finding: Finding, trial: Trial) -> Stated:
    half = re.search(r"\(\+- (\S+) kg\)", finding.evidence)
    return Stated(finding.numbers["mass_kg"], float(half[1]) if half else np.inf)  # a mass that is not determined


def _delay(finding: Finding, trial: Trial) -> Stated:
    numbers = finding.numbers
    if finding.joint:
        return Stated(numbers["value"], numbers["half_width"])
    return Stated(numbers["delay_s"], 1.96 * numbers["std_s"])


def _counterbalance(finding: Finding, trial: Trial) -> Stated:
    numbers = finding.numbers
    return Stated(numbers["value"] * np.exp(1j * numbers["phase_rad"]), numbers["half_width"])


_READ: Mapping[str, Callable[[Finding, Trial], Stated]] = {
    "time scale": _clock,
    "two clocks": lambda finding, trial: Stated(1.0 + finding.numbers["value"], finding.numbers["half_width"], 1.0),
    "torque scale": _scale,
    "torque unit": lambda finding, trial: Stated(finding.numbers["ratio"], finding.numbers["half_width"], 1.0),
    "torque delay": _delay,
    "spring": lambda finding, trial: Stated(finding.numbers["value"], finding.numbers["half_width"]),
    "drift": lambda finding, trial: Stated(finding.numbers["value"], finding.numbers["half_width"]),
    "counterbalance": _counterbalance,
    "load at the flange": _load,
    "tilt": _gravity,
    "mounting": _gravity,
}


@dataclass(frozen=True)
class CleanLog:
    """What the checks say of the log without the fault."""

    trial: Trial
    subject: CheckedLog
    findings: tuple[Finding, ...]

    def says(self, finding: Finding, nothing: complex | np.ndarray) -> complex | np.ndarray:
        """Return the figure of such a finding on the clean log; ``nothing`` where it tells none."""
        fit, delay = self.subject.fit, self.subject.delay
        if finding.name == "torque delay" and delay is not None:
            return delay.seconds
        if finding.name == "torque unit" and fit is not None:
            theta, known = fit.model.nominal(), self.subject.known
            if known is not None and "the earlier estimate predicts" in finding.evidence:
                return against_known(fit, known, None)[0]
            return nothing if theta is None else against_nominal(fit, theta, None)[0]
        if finding.name == "torque scale" and finding.joint and not finding.evidence.startswith("against"):
            own = [one for one in self.subject.scales if one.joint == finding.joint.split(", ")[0] and not one.is_open]
            return 1.0 / own[0].factor if own else nothing
        same = [one for one in self.findings if (one.name, one.joint) == (finding.name, finding.joint)]
        found = stated(same[0], self.trial) if same else None
        return nothing if found is None else found.value


def without_fault(finding: Finding, twice: Sequence[tuple[Trial, Sequence[Finding]]]) -> complex | np.ndarray | None:
    """Return the figure of a recorded log without a fault, by what is told with some of it and with twice as much.

    What a recorded log has of itself is not told where it is small, and adds to the fault all the same. None where it
    is not told both times. A direction is no straight line of the fault: it counts in narrow intervals alone.
    """
    key = (finding.name, finding.joint)
    once, more = (
        next((stated(one, trial) for one in findings if (one.name, one.joint) == key), None)
        for trial, findings in twice
    )
    if once is None or more is None or (np.ndim(once.value) and not (once.is_narrow and more.is_narrow)):
        return None
    values = np.asarray(once.value), np.asarray(more.value)
    return values[0] ** 2 / values[1] if once.is_factor else 2.0 * values[0] - values[1]


def grade(
    finding: Finding, wanted: Wanted | None, faulty: Trial, clean: CleanLog, own: complex | np.ndarray | None = None
) -> str:
    """Return how a finding on the faulty log states what it has to: ``exact``, ``wide`` or ``false``.

    ``own`` is the figure of a recorded log without the fault; None for what is told of the clean one.
    """
    if wanted is None:
        return "exact"
    if finding.name == "scale not determined":
        return "exact" if any(one.name == finding.name for one in clean.findings) else "false"
    if isinstance(wanted, str):
        return "exact" if wanted in finding.remedy else "false"
    if isinstance(wanted, Trial):
        return "exact" if _restores(finding, faulty, wanted) else "false"
    found = stated(finding, faulty)
    if found is None:
        return "false"
    already = clean.says(finding, found.nothing) if own is None else own
    if isinstance(wanted, np.ndarray):
        return found.grade(wanted if already is found.nothing else already)
    return found.grade(wanted * already if found.is_factor else wanted + already)


def _restores(finding: Finding, faulty: Trial, right: Trial) -> bool:
    """Return whether the edit that a finding asks for gives the columns of the log without the fault back."""
    edited = EDITS[finding.name](faulty, finding)
    return all(np.allclose(_in_si(edited, name), _in_si(right, name)) for name in edited.columns)


def _in_si(trial: Trial, name: str) -> Array:
    """Return a signal as the case of a trial reads its columns."""
    columns, values = trial.case.columns, trial.columns[name]
    signal = {"tau": "torque", "i": "current"}.get(name, name)
    return columns.to_si(signal, values) if signal in QUANTITY else values
