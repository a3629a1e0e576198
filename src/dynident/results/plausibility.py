"""What plausible bodies cost, and where the data contradict the robot model, in sentences."""

from __future__ import annotations

from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.plausibility import TOTAL_MASS, ContradictedMass, Plausibility
from dynident.identification.estimate.validation import Validation
from dynident.results.text import format_number, format_percent, label


def plausibility_lines(estimate: Estimate, test: Validation | None) -> list[str]:
    """Return what the bounds cost, which masses the data contradict, and which links have no nominal inertia."""
    facts = Plausibility.of(estimate.run)
    if facts is None:
        return []
    lines = [cost_line(facts, test), *map(contradiction, facts.contradicted)]
    if facts.uniform:
        names = ", ".join(map(label, facts.uniform))
        lines.append(f"no possible nominal inertia: {names}: a uniform body in its place; correct the robot model")
    return [line for line in lines if line]


def cost_line(facts: Plausibility, test: Validation | None) -> str:
    """Return what plausible bodies change the test error by; empty without a test."""
    if test is None or test.free_bodies_error is None or not test.free_bodies_error > 0:
        return ""
    change = test.total_relative_error / test.free_bodies_error - 1.0
    error = format_percent(test.free_bodies_error)
    return f"plausible links change the test error by {100 * change:+.1f} % of itself ({error} with --bodies free)"


def contradiction(mass: ContradictedMass) -> str:
    """Return how the data contradict a mass range, and what became of it."""
    name = TOTAL_MASS if mass.name == TOTAL_MASS else f"mass of {label(mass.name)}"
    fate = "its range is relaxed" if mass.is_relaxed else "the stated range is kept: check it"
    numbers = f"chi-square {format_number(mass.statistic, 3)} > {format_number(mass.limit, 3)}"
    gain = f"training error {format_number(100 * mass.gain, 2)} % lower without the range"
    return f"{name}: the data contradict it ({numbers}; {gain}); {fate}"
