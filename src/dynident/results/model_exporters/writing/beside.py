"""The file beside a simulator's file, and the proof that both together are the whole model."""

from __future__ import annotations

from pathlib import Path

from dynident.results.model_exporters.subject.drives import Drives, Term


def place_beside(path: Path) -> Path:
    """Return where the document of a model stands beside an exported file."""
    return path.with_name(f"{path.name}.dynident.json")


def left_out(drives: Drives, *, armature: bool, coupled: bool) -> tuple[Term, ...]:
    """Return the coefficients that a format cannot hold.

    Args:
        drives: The drives.
        armature: Whether it holds rotor inertias.
        coupled: Whether it holds drives that turn several joints.
    """
    rotors: list[Term] = []
    if not armature:
        alone = drives.alone if not coupled else drives.alone | True
        rotors = [
            Term(name, "rotor_inertia", "Ia", float(value), "kg m^2 or kg", {})
            for name, value, is_alone in zip(drives.joints, drives.armature, alone, strict=True)
            if value and is_alone
        ]
    return (*rotors, *(() if coupled else drives.coupled_rest()), *drives.rest)


def sharp_note(drives: Drives, target: str) -> tuple[str, ...]:
    """Return the sentence on dry friction: simulators have the sharp sign, the model may have a smooth one."""
    if not drives.dry.any():
        return ()
    return (
        f"dry friction is sharp at standstill in {target}, and tanh(dq / width) in the model where a width was set: "
        "torques differ below a few widths of speed",
    )
