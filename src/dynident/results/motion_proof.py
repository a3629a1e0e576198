"""A simulation of an identified model along the motion of a log: its runs as a table, what was not run in lines."""

from __future__ import annotations

from collections.abc import Iterator

from dynident.exports.models.proving.followed_motion import MOST_STEPS, FollowedMotion, MotionProof
from dynident.results.text import Column, Table, format_number, format_percent, label


def followed_line(proof: MotionProof) -> str:
    """Return which motion was followed."""
    start = f"{round(proof.start, 3):.13g}"  # seconds since 1970 have ten digits before the point
    return f"motion: {proof.duration:.3g} s of {label(proof.log)} from {start} s on, low-pass filtered at 10 Hz"


def runs_table(proof: MotionProof) -> Table:
    """Return the runs: simulator, controller, step, length of the motion, largest error, and whether it diverged."""
    columns = (
        Column("simulator"),
        Column("controller"),
        Column("step", "ms", numeric=True),
        Column("motion", "s", numeric=True),
        Column("largest error", "rad or m", numeric=True),
        Column("of the span", numeric=True),
        Column("diverged"),
    )
    rows = [_row(run) for run in proof.runs if not run.why_not]
    note = "error: of a position; span: of the joint's motion, 0.1 rad or m at least; torques have no limits"
    return Table(columns, tuple(rows), note)


def _row(run: FollowedMotion) -> tuple[str, ...]:
    error = max(run.error, default=float("nan"))
    share = float("nan") if run.share is None else run.share
    return (
        label(run.simulator),
        run.controller,
        f"{1e3 * run.step:g}",
        f"{run.duration:.3g}",
        format_number(error, 2),
        format_percent(share),
        label(run.failure) if run.failure else "no",
    )


def not_run_lines(proof: MotionProof) -> Iterator[str]:
    """Yield what was not run or not to its end, and why, and which shapes stand in the way of the motion."""
    if proof.touching:
        yield label(proof.contact)
    for reason in dict.fromkeys((run.simulator, run.why_not) for run in proof.runs if run.why_not):
        yield f"not simulated with {reason[0]}: {label(reason[1])}"
    shorter = [run for run in proof.runs if not (run.why_not or run.failure) and run.duration < 0.99 * proof.duration]
    for run in {run.simulator: run for run in shorter}.values():
        step = f"steps of {1e6 * run.duration / MOST_STEPS:.2g} µs at most, and no more than {MOST_STEPS:,} are made"
        yield f"{label(run.simulator)}: the first {run.duration:.3g} s only; friction of a light joint asks for {step}"


def condition_line(proof: MotionProof) -> str:
    """Return the condition number of the mass matrix along the motion, beside that of the robot model."""
    own = f"condition number of M(q) along the motion: {_numbers(proof.condition)}"
    if proof.nominal_condition is None:
        return f"{own}; the robot model states no inertias for every link"
    return f"{own}; with the bodies of the robot model and the same rotors {_numbers(proof.nominal_condition)}"


def _numbers(values: tuple[float, float]) -> str:
    median, largest = (format_number(value, 3) for value in values)
    return f"median {median}, largest {largest}"
