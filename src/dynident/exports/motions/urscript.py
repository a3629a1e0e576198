"""Universal Robots: a script that goes to the first posture and follows the samples by ``servoj``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dynident.errors import BadOption
from dynident.exports.motions._motion import APPROACH_SHARE, APPROACH_SLOW, DrivenMotion
from dynident.exports.motions._printed import Decimals, Printed
from dynident.exports.motions._programs import header_lines, name_notes
from dynident.exports.motions.base import MotionContent, MotionExporter, MotionFigures
from dynident.exports.names_in_files import program_name

#: Joints of the arm, and the step in s that every control cycle is a part of (e-Series; CB3 takes multiples of 8 ms).
JOINTS, CYCLE = 6, 0.002

#: Postures in one list, digits after the point, and seconds for which the last posture is held.
CHUNK, PLACES, HOLD = 100, 8, 0.5

_WORDS = frozenset(
    "AND BREAK CONTINUE DEF ELIF ELSE END FALSE GLOBAL HALT IF LOCAL NOT OR RETURN RUN SEC THREAD TRUE "
    "WHILE XOR MOVEJ MOVEL SERVOJ STOPJ SLEEP FOLLOW H I K N P".split()
)


@dataclass(frozen=True)
class ServoFigures(MotionFigures):
    """Largest acceleration that round-off adds, in rad/s^2, gain and lookahead time of servoj."""

    acceleration_by_round_off: float
    gain: float
    lookahead_s: float


@dataclass(frozen=True)
class Urscript(MotionExporter):
    """URScript for six joints: ``movej`` to the first posture, then ``servoj`` at every sample of an embedded list.

    Attributes:
        gain: Gain of servoj, 100 to 2000.
        lookahead: Look-ahead time of servoj in s, 0.03 to 0.2.
        most_points: Postures that a script may have.
    """

    gain: float = 300.0
    lookahead: float = 0.1
    most_points: int = 20000

    suffix: ClassVar = ".script"
    rate: ClassVar = 125.0
    moves_itself: ClassVar = True
    approach_in_samples: ClassVar = False

    def __post_init__(self) -> None:
        if not 100 <= self.gain <= 2000:
            raise BadOption("gain", self.gain, "servoj takes 100 to 2000")
        if not 0.03 <= self.lookahead <= 0.2:
            raise BadOption("lookahead", self.lookahead, "servoj takes 0.03 to 0.2 s")
        if self.most_points < 2:
            raise BadOption("most_points", self.most_points, "give 2 or more")

    def content(self, subject: DrivenMotion, path: Path) -> MotionContent:
        lists = {f"P{k}" for k in range(self.most_points // CHUNK + 1)}
        name = program_name(path, "URScript", 64, _WORDS | lists)
        if len(subject.joints) != JOINTS or not all(subject.revolute):
            raise BadOption("exporter", "urscript", f"it takes {JOINTS} turning joints, not {len(subject.joints)}")
        assert subject.rate is not None
        step = 1.0 / subject.rate
        if abs(step / CYCLE - round(step / CYCLE)) > 1e-9:
            choices = "500, 250, 125, 100, 62.5 or 50"
            raise BadOption("rate", subject.rate, f"servoj takes whole multiples of {1000 * CYCLE:g} ms: {choices}")
        time, signals = subject.samples()
        if len(time) > self.most_points:
            step_text = f"the motion has {len(time)} postures; lower --rate, fewer --repeats, or raise most_points"
            raise BadOption("most_points", self.most_points, step_text)
        decimals = Decimals(np.ones(JOINTS), PLACES)
        texts = decimals.texts(signals[0])
        lines = self._program(subject, name, texts, round(step, 6))
        printed = Printed(time, decimals.read(texts)[None], decimals.round_off[None])
        seen = float(4 * decimals.round_off.max() * subject.rate**2)
        figures = ServoFigures(seen, self.gain, self.lookahead)
        return MotionContent({path: ("\n".join(lines) + "\n").encode("ascii")}, printed, name_notes(subject), figures)

    def _program(self, subject: DrivenMotion, name: str, texts: list[list[str]], step: float) -> list[str]:
        limits = subject.plan.limits
        slow = APPROACH_SHARE * float(np.min(limits.velocity))
        slow = slow if np.isfinite(slow) else APPROACH_SLOW
        gentle = min(2 * slow, APPROACH_SHARE * float(np.min(limits.acceleration)))
        servo = f"0, 0, {step:g}, {self.lookahead:g}, {self.gain:g}"
        own = (
            "At a speed slider or reduced mode below 100 % servoj steps last longer: the motion is then another one.",
            f"Starts with a slow movej. Samples each {step:g} s, positions rounded to {PLACES} decimals.",
        )
        lines = [f"def {name}():", *(f"  # {line}" for line in header_lines(subject, *own))]
        lines += [
            "  def follow(p, n):",
            "    k = 0",
            "    while k < n:",
            "      i = 6 * k",
            f"      servoj([p[i], p[i + 1], p[i + 2], p[i + 3], p[i + 4], p[i + 5]], {servo})",
            "      k = k + 1",
            "    end",
            "  end",
        ]
        move = f"a={gentle:.6f}, v={slow:.6f}"
        if subject.posture is not None:
            stated = Decimals(np.ones(JOINTS), PLACES).texts(subject.posture[None])[0]
            lines += [f"  movej([{', '.join(stated)}], {move})"]
        lines += [f"  movej([{', '.join(texts[0])}], {move})", "  sleep(1.0)"]
        for number, first in enumerate(range(0, len(texts), CHUNK)):
            part = texts[first : first + CHUNK]
            lines += [f"  p{number} = ["]
            lines += [f"    {', '.join(row)}{',' if k + 1 < len(part) else ']'}" for k, row in enumerate(part)]
        for number, first in enumerate(range(0, len(texts), CHUNK)):
            lines += [f"  follow(p{number}, {min(CHUNK, len(texts) - first)})"]
        hold = int(np.ceil(HOLD / step - 1e-9))
        lines += ["  h = 0", f"  while h < {hold}:", f"    servoj([{', '.join(texts[-1])}], {servo})", "    h = h + 1"]
        return [*lines, "  end", f"  stopj({gentle:.6f})", "end"]
