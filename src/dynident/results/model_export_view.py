"""What an export of a model shows on the terminal: the proof as a table, what is left out in a few lines.

A simulation along the motion of a log is a table of its runs, with what was not run in lines.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from dynident.exports.models import ModelExport, Proof
from dynident.exports.models.proving.followed_motion import MOST_STEPS, FollowedMotion, MotionProof
from dynident.results.text import MISSING, Column, Table, columns_of, format_number, format_percent, label


def proofs_table(proofs: Sequence[Proof], units: Collection[str]) -> Table:
    """Return the largest differences of torques, of some units, by engine, those not asked with the reason."""
    rows = []
    for proof in proofs:
        if proof.difference is None or proof.relative is None:
            rows.append((proof.engine, "not proved", MISSING, MISSING))
        else:
            rows.append((proof.engine, proof.what, f"{proof.difference:.1e}", f"{proof.relative:.1e}"))
    columns = columns_of(
        "loaded again by",
        "compared",
        Column("difference", " or ".join(sorted(set(units), reverse=True)), numeric=True),
        ">relative",
    )
    states = max((proof.states for proof in proofs), default=0)
    allowed = " or ".join(f"{limit:.0e}" for limit in sorted({proof.allowed for proof in proofs if proof.states}))
    note = f"largest difference of a torque on {states} random states, at most {allowed or 'nothing'} allowed"
    return Table(columns, tuple(rows), note)


def not_proved_lines(proofs: Sequence[Proof]) -> Iterator[str]:
    """Yield why engines were not asked."""
    for proof in proofs:
        if proof.why_not:
            yield f"not proved with {proof.engine}: {label(proof.why_not)}"


def left_out_lines(export: ModelExport) -> Iterator[str]:
    """Yield what the format cannot hold: the coefficients by joint, and the torque that goes with them."""
    if not export.left_out:
        return
    by_joint: dict[str, list[str]] = {}
    for term in export.left_out:
        by_joint.setdefault(term.joint, []).append(f"{term.symbol} = {term.value:.4g} {term.unit}".rstrip())
    yield f"\nleft out of {export.files[0]}, and in {export.files[-1]}:"
    for joint, terms in by_joint.items():
        lost = export.neglected.get(joint)
        size = (
            "" if lost is None else f"; torque of the file off by {format_number(lost, 3)} {export.units[joint]} (rms)"
        )
        yield f"  {label(joint)}: {', '.join(terms)}{size}"


def followed_line(proof: MotionProof) -> str:
    """Return which motion was followed."""
    start = f"{round(proof.start, 3):.13g}"  # seconds since 1970 have ten digits before the point
    return f"motion: {proof.duration:.3g} s of {label(proof.log)} from {start} s on, low-pass filtered at 10 Hz"


def runs_table(proof: MotionProof) -> Table:
    """Return the runs: simulator, controller, step, length of the motion, largest error, and whether it diverged."""
    columns = columns_of(
        "simulator", "controller", ">step [ms]", ">motion [s]", ">largest error [rad or m]", ">of the span", "diverged"
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
