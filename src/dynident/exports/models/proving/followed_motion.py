"""What was simulated to see whether a model follows the motion of a log, as values."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any

#: Steps of the own integration at most, as friction of light joints asks for short ones; the motion is cut there.
MOST_STEPS = 300_000

#: Pairs of touching bodies that are named at most.
PAIRS = 4


@dataclass(frozen=True)
class FollowedMotion:
    """One run: a simulator, a controller, and how well the joints followed.

    Attributes:
        simulator: Its name with its version.
        controller: Name of the controller.
        step: Length of a step of the controller in s; in MuJoCo of the integration too.
        duration: What was to be followed, in s from the start of the motion; 0 where nothing was run.
        error: Largest position error of each joint, shape (n,), in rad or m; empty where nothing was run.
        share: Largest of them over the span of the joint's motion, 0.1 rad or m at least; None where nothing was run.
        failure: Where it diverged, in words: a joint further from the motion than its span. Empty where it did not.
        why_not: Why nothing was run; empty where it was.
    """

    simulator: str
    controller: str
    step: float
    duration: float = 0.0
    error: tuple[float, ...] = ()
    share: float | None = None
    failure: str = ""
    why_not: str = ""


@dataclass(frozen=True)
class MotionProof:
    """What was run to see whether a model follows the motion of a log.

    Attributes:
        log: Name of the log.
        start: Where the part that is followed begins, in s of the log.
        duration: Its length, in s.
        runs: The runs.
        condition: Median and largest condition number of the mass matrix along the motion.
        nominal_condition: The same with the bodies of the robot model and the same rotors; None where it states none.
        touching: Pairs of bodies whose shapes touch along the motion in MuJoCo, which pushes them apart.
    """

    log: str
    start: float
    duration: float
    runs: tuple[FollowedMotion, ...]
    condition: tuple[float, float]
    nominal_condition: tuple[float, float] | None
    touching: tuple[tuple[str, str], ...] = ()

    @property
    def failures(self) -> tuple[FollowedMotion, ...]:
        """The runs that diverged."""
        return tuple(run for run in self.runs if run.failure)

    @property
    def contact(self) -> str:
        """Which shapes touch along the motion, and what to do; empty for none."""
        if not self.touching:
            return ""
        pairs = ", ".join(f"{one} and {two}" for one, two in self.touching[:PAIRS])
        more = f" and {len(self.touching) - PAIRS} more pairs" if len(self.touching) > PAIRS else ""
        return (
            f"shapes that touch along the motion, which MuJoCo pushes apart: {pairs}{more}; where the robot does not "
            "touch itself, leave the pair out in the MJCF (<contact><exclude body1= body2=/></contact>)"
        )

    def data(self) -> dict[str, Any]:
        """Return it as plain data; a number that does not exist is None."""
        found = asdict(self)
        for key in ("condition", "nominal_condition"):
            values = getattr(self, key)
            named = zip(("median", "largest"), values or (), strict=False)
            found[key] = {name: v if isfinite(v) else None for name, v in named} if values else None
        found["touching"] = [list(pair) for pair in self.touching]
        return found | {"runs": [asdict(run) | {"error": list(run.error)} for run in self.runs]}
