"""Works side by side: repeats in turns, times of the processor and of the clock, their spread, and what was compared.

A row of the table is a file of ``benchmarks.speed.rows`` with ``measure() -> Record``. A ratio is taken repeat by
repeat, between calls that follow each other, and its median and quartiles are stated: a machine that slows both sides
alike moves no ratio. Times are of the processor, summed over threads, unless a line says that it is of the clock.
"""

from __future__ import annotations

import importlib
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import metadata
from types import ModuleType
from typing import Any

#: Calls shorter than this, in s, run once before they are timed; and how often a short call is timed in one repeat.
SHORT, TIMES = 0.1, 9


@dataclass(frozen=True)
class Times:
    """Times of one side in s, by clock: the median of the calls of each repeat, and the least of all calls."""

    processor: list[float] = field(default_factory=list)
    wall: list[float] = field(default_factory=list)
    least: dict[str, float] = field(default_factory=dict)

    def shortest(self, clock: str) -> float:
        """Return the time of the shortest call in s."""
        return self.least.get(clock, min(getattr(self, clock)))

    def note(self, processor: list[float], wall: list[float]) -> None:
        """Take the calls of one repeat."""
        for clock, values in (("processor", processor), ("wall", wall)):
            getattr(self, clock).append(statistics.median(values))
            self.least[clock] = min(self.least.get(clock, values[0]), *values)

    def summary(self, clock: str, per: int = 1) -> dict[str, float]:
        """Return least, quartiles and median of a call, divided by ``per``, in s."""
        low, middle, high = quartiles([value / per for value in getattr(self, clock)])
        return {"least": self.shortest(clock) / per, "lower": low, "median": middle, "upper": high}


@dataclass(frozen=True)
class Line:
    """One line of the table.

    Attributes:
        work: What is done.
        here: The side of dynident.
        peer: The side that it is compared with; "" where the figure stands alone.
        reach: The ratio that is aimed at or, without a peer, the seconds at most; None where none was set.
        per: Times are divided by this number, of samples say.
        clock: "processor" or "wall".
    """

    work: str
    here: str
    peer: str = ""
    reach: float | None = None
    per: int = 1
    clock: str = "processor"


@dataclass
class Record:
    """What a row found.

    Attributes:
        name: Of the row.
        about: What was measured, in a sentence.
        lines: Of the table.
        times: Of each side.
        checks: What was compared between the sides: [what, how far apart, at most].
        missing: Peers that could not run, with the reason.
        facts: Other figures.
    """

    name: str
    about: str
    lines: list[Line] = field(default_factory=list)
    times: dict[str, Times] = field(default_factory=dict)
    checks: list[tuple[str, float, float]] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)

    def agree(self, what: str, apart: float, most: float) -> None:
        """Note how far two sides are apart; a row whose sides differ has no figures.

        Raises:
            SystemExit: They differ by more than ``most``.
        """
        self.checks.append((what, float(apart), most))
        if not apart <= most:
            raise SystemExit(f"{self.name}: {what}: {apart:.3g} apart, at most {most:.3g} allowed")

    def peer(self, module: str, package: str = "") -> ModuleType | None:
        """Return a peer, or note why it cannot be had."""
        try:
            found = importlib.import_module(module)
        except Exception as fault:
            self.missing[package or module] = f"{type(fault).__name__}: {fault}"
            return None
        self.facts.setdefault("versions", {})[package or module] = metadata.version(package or module)
        return found

    def time(self, calls: Mapping[str, Callable[[], object]], repeats: int) -> None:
        """Measure some sides in turns."""
        self.times |= in_turns(calls, repeats)

    def ratio(self, line: Line) -> tuple[float, float, float]:
        """Return lower quartile, median and upper quartile of peer by here, repeat by repeat."""
        here, peer = (getattr(self.times[side], line.clock) for side in (line.here, line.peer))
        if len(here) != len(peer):  # not in turns: of the medians
            found = statistics.median(peer) / statistics.median(here)
            return found, found, found
        return quartiles([b / a for a, b in zip(here, peer, strict=True)])

    def data(self) -> dict[str, Any]:
        """Return all of it as JSON takes it."""
        return {
            "row": self.name,
            "about": self.about,
            "lines": [self._line(line) for line in self.lines],
            "checks": [{"what": what, "apart": apart, "at most": most} for what, apart, most in self.checks],
            "missing": self.missing,
            "facts": self.facts,
        }

    def _line(self, line: Line) -> dict[str, Any]:
        found: dict[str, Any] = {"work": line.work, "clock": line.clock, "repeats": len(self.times[line.here].wall)}
        found["here"] = {"name": line.here, **self.times[line.here].summary(line.clock, line.per)}
        found["reach"] = line.reach
        if not line.peer:
            return found
        if line.peer not in self.times:
            return found | {"peer": {"name": line.peer, "missing": True}}
        low, middle, high = self.ratio(line)
        found["peer"] = {"name": line.peer, **self.times[line.peer].summary(line.clock, line.per)}
        return found | {"ratio": {"lower": low, "median": middle, "upper": high}}


def in_turns(calls: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, Times]:
    """Return the times of each call, one repeat of all after the other.

    A short call runs once more before it is timed: the call before has filled the caches with its own. On a machine
    that does other work the caches are taken away between its calls too; the least time is that of an undisturbed call.
    """
    times = {name: Times() for name in calls}
    for _ in range(repeats):
        for name, call in calls.items():
            short = min(times[name].processor, default=0.0) < SHORT
            if short:
                call()
            walls, processors = [], []
            for _ in range(TIMES if short else 1):
                wall, processor = time.perf_counter(), time.process_time()
                call()
                processors.append(time.process_time() - processor)
                walls.append(time.perf_counter() - wall)
                if processors[-1] >= SHORT:
                    break
            times[name].note(processors, walls)
    return times


def quartiles(values: list[float]) -> tuple[float, float, float]:
    """Return lower quartile, median and upper quartile."""
    if len(values) == 1:
        return values[0], values[0], values[0]
    low, middle, high = statistics.quantiles(values, n=4, method="inclusive")
    return low, middle, high
