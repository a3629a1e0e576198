"""What a method states of its own run, as values; files and JSON have these keys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, fields
from typing import Any


@dataclass(frozen=True, kw_only=True)
class MethodRun:
    """The run of a method; what one method alone has to state is a class in its file.

    Attributes:
        iterations: Rounds until it settled.
        simulations: Simulated logs.
        evaluations: Values of the objective of a search.
        trace: Objective after each iteration, or residual after each round.
        times: Seconds of motion at each point of the course.
        course: Parameters at these times, one list each.
        objective: That it minimised.
        optimum: Certified optimum of the objective.
        lower_bound: Certificate: no estimate has a smaller objective.
        gap: Between objective and certificate, as a share.
        scale: Of each joint's residual, in N m or N.
        down_weighted: Rows of each joint that count less than half.
        rejected: Rows of each joint that do not count.
        verdict: ``converged``, or how it ended otherwise.
        prior: Source of the prior.
        data_share: Share of each standard parameter that comes from data, shape (p,).
        seconds: Time of the fit, in s.
        streamed: Whether the logs were compressed as a stream.
        segments: Segments of the compressed logs.
    """

    iterations: int | None = None
    simulations: int | None = None
    evaluations: int | None = None
    trace: Sequence[float] | None = None
    times: Sequence[float] | None = None
    course: Sequence[Sequence[float]] | None = None
    objective: float | None = None
    optimum: float | None = None
    lower_bound: float | None = None
    gap: float | None = None
    scale: Sequence[float] | None = None
    down_weighted: Sequence[int] | None = None
    rejected: Sequence[int] | None = None
    verdict: str | None = None
    prior: str | None = None
    data_share: Sequence[float] | None = None
    seconds: float | None = None
    streamed: bool | None = None
    segments: int | None = None

    def data(self) -> dict[str, Any]:
        """Return it as plain data; fields of all methods only where they are known."""
        needed = {each.name for each in fields(self) if each.default is MISSING}
        return {name: value for name, value in asdict(self).items() if value is not None or name in needed}


@dataclass(frozen=True, kw_only=True)
class RecordedRun(MethodRun):
    """A run from an estimate file, which is read without its method.

    Attributes:
        own: What its method alone states, as plain data.
    """

    own: Mapping[str, Any]

    def data(self) -> dict[str, Any]:
        return {name: value for name, value in super().data().items() if name != "own"} | dict(self.own)


def recorded_run(data: Mapping[str, Any]) -> RecordedRun:
    """Return the run in plain data."""
    shared = {each.name for each in fields(MethodRun) if data.get(each.name) is not None}
    own = {name: value for name, value in data.items() if name not in shared}
    return RecordedRun(own=own, **{name: data[name] for name in shared})
