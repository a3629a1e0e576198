"""The lines of comment at the head of a robot program: what it drives, how fast, and what to look at before."""

from __future__ import annotations

from dynident.results.exporters._motion import DrivenMotion
from dynident.results.names_in_files import comment_text, shown_names


def header_lines(motion: DrivenMotion, *own: str) -> list[str]:
    """Return lines of plain text, without the sign of a comment; ``own`` are those of the target."""
    shown, _ = shown_names(motion.joints)
    share = motion.speed
    lines = [
        f"Excitation of {motion.plan.robot} - written by dynident",
        f"plan: sha256 {motion.plan_sha256}",
        f"joints, in order: {' '.join(shown)}",
        f"{motion.repeats} x {motion.plan.trajectory.duration:.6g} s, {motion.motion.duration:.6g} s from rest to rest",
        f"speed: {100 * share:.6g} % of the design: same path, speeds x {share:.6g}, accelerations x {share**2:.6g}",
        "A speed override of the controller stretches time further: identify from measured time and positions only.",
        "The approach is not checked for obstacles, the motion as far as its plan says. Keep a hand on the stop.",
        *own,
    ]
    cut = [line[i : i + 110] for line in map(str, lines) for i in range(0, max(len(line), 1), 110)]
    return [comment_text(line) for line in cut]


def name_notes(motion: DrivenMotion) -> tuple[str, ...]:
    """Return the sentence that says which names are written otherwise; none where all are as they are."""
    _, changed = shown_names(motion.joints)
    return tuple(f"joint {name!r} stands in comments as {new}" for name, new in changed.items())
