"""The kinds of faults: what names each rightly, and between which strengths its smallest one is looked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.faults import injections as put
from benchmarks.faults.trials import Trial

Injection = Callable[[Trial, float, np.random.Generator], Trial]
Wanted = str | float | np.ndarray | Trial


@dataclass(frozen=True)
class Kind:
    """A kind of fault.

    Attributes:
        name: In words, with the unit of its strength.
        right: Findings that name it.
        inject: Puts it into a trial at a strength.
        between: Strengths between which the smallest one that matters is looked for; None where it has none.
        fixed: Strengths, or numbers of joints or variants, where none is looked for.
        needs: A column that the log must have.
        why: Why there is no strength, or why no smallest one is looked for.
        joint: Number of the joint that must be named, of a trial and a strength; None where it is the whole log.
        of_all: Whether a finding about single joints does not name it.
        states: What else the finding must state, of the clean trial and a strength: words of its remedy, a figure, a
            direction of gravity, or, as a trial, the log that its edit must give back; None where there is nothing.
    """

    name: str
    right: tuple[str, ...]
    inject: Injection
    between: tuple[float, float] | None = None
    fixed: tuple[float, ...] = (0.0, 1.0, 3.0)
    needs: str = ""
    why: str = "either there or not"
    joint: Callable[[Trial, float], int] | None = None
    of_all: bool = False
    states: Callable[[Trial, float], Wanted] | None = None


REFUSED = "one such row and the log is refused"
HARMLESS = "no effect where the filter differentiates positions itself"

KINDS = (
    Kind("time in ms", ("time unit",), lambda c, s, g: put.timed(c, 1e3), fixed=(1.0,), states=lambda c, s: "time: ms"),
    Kind("time in us", ("time unit",), lambda c, s, g: put.timed(c, 1e6), fixed=(1.0,), states=lambda c, s: "time: us"),
    Kind(
        "clock too fast [share]",
        ("time scale",),
        lambda c, s, g: put.timed(c, 1 + s),
        (1e-3, 0.5),
        states=lambda c, s: 1 + s,
    ),
    Kind("jitter [samples]", ("time jitter",), put.jitter, (0.05, 30.0), (0.5, 1.0, 3.0)),
    Kind("repeated rows [share]", ("repeated rows",), put.duplicates, fixed=(0.0, 0.01, 0.2), why=REFUSED),
    Kind("rows out of order [share]", ("rows out of order",), put.disorder, fixed=(0.0, 0.005, 0.02), why=REFUSED),
    Kind("clock starts again [after]", ("time runs back",), put.restart, fixed=(0.2, 0.5, 0.8), why=REFUSED),
    Kind("gap in time [s]", ("gap in time",), put.gap, (0.03, 5.0), (0.1, 0.4, 2.0)),
    Kind(
        "not finite [share]",
        ("values that are not finite", "signal missing"),
        put.lost,
        fixed=(0.0, 0.01, 0.3),
        why=REFUSED,
    ),
    Kind("two publishers [share]", ("two publishers",), put.flips, (1e-4, 0.5)),
    Kind(
        "one spike [range]",
        ("spikes",),
        lambda c, s, g: put.spikes(c, s, g, 1),
        (0.01, 100.0),
        joint=lambda c, s: put.heaviest(c),
    ),
    Kind("five spikes [range]", ("spikes",), put.spikes, (0.01, 100.0), joint=lambda c, s: put.heaviest(c)),
    Kind("encoder wrap [quantile]", ("encoder wrap",), put.wrap, fixed=(0.3, 0.5, 0.8), joint=lambda c, s: 0),
    Kind(
        "positions in deg",
        ("positions in degrees",),
        lambda c, s, g: c.with_columns(q=put.DEG * c.columns["q"]),
        fixed=(1.0,),
        states=lambda c, s: "position: deg",
    ),
    Kind(
        "rad declared as deg",
        ("positions in radians",),
        lambda c, s, g: put.declared(c, position="deg"),
        fixed=(1.0,),
        states=lambda c, s: "position: rad",
    ),
    Kind(
        "velocities in deg/s",
        ("velocity unit",),
        lambda c, s, g: c.with_columns(dq=put.DEG * c.columns["dq"]),
        fixed=(1.0,),
        needs="dq",
        states=lambda c, s: "velocity: deg/s",
    ),
    Kind(
        "sign of velocity",
        ("velocity sign",),
        lambda c, s, g: put.turned(c, ("dq",), int(s)),
        needs="dq",
        joint=lambda c, s: int(s),
    ),
    Kind(
        "order of velocities",
        ("velocity order",),
        lambda c, s, g: put.swapped(c, ("dq",), int(s)),
        needs="dq",
        states=lambda c, s: c,
    ),
    Kind(
        "lag of velocity [samples]",
        ("velocity lag",),
        lambda c, s, g: put.delayed(c, s, "dq"),
        fixed=(2.0, 4.0, 8.0),
        needs="dq",
        why=HARMLESS,
    ),
    Kind("saturation [share]", ("torque saturation",), put.clipped, (1e-4, 0.4), joint=lambda c, s: put.heaviest(c)),
    Kind(
        "coarse torque [range]",
        ("coarse torques",),
        lambda c, s, g: put.coarse(c, s, "tau"),
        (1e-3, 0.5),
        joint=lambda c, s: put.heaviest(c),
    ),
    Kind(
        "coarse position [range]",
        ("coarse positions",),
        lambda c, s, g: put.coarse(c, s, "q"),
        (1e-4, 0.5),
        joint=lambda c, s: put.heaviest(c),
    ),
    Kind(
        "joint never moved", ("joint never moved",), lambda c, s, g: put.still(c, int(s), g), joint=lambda c, s: int(s)
    ),
    Kind("standstill [share]", ("standstill",), put.pause, fixed=(0.55, 0.7, 0.9), why="samples at rest are left out"),
    Kind(
        "sign of torque",
        ("torque sign",),
        lambda c, s, g: put.turned(c, ("tau",), int(s)),
        joint=lambda c, s: int(s),
        states=lambda c, s: c,
    ),
    Kind(
        "signs of all torques",
        ("torque sign",),
        lambda c, s, g: c.with_columns(tau=-c.columns["tau"]),
        fixed=(1.0,),
        states=lambda c, s: c,
    ),
    Kind(
        "order of torques", ("torque order",), lambda c, s, g: put.swapped(c, ("tau",), int(s)), states=lambda c, s: c
    ),
    Kind(
        "sign of position",
        ("position sign",),
        lambda c, s, g: put.turned(c, ("q", "dq"), int(s)),
        fixed=(1, 2, 3),
        joint=lambda c, s: int(s),
        states=lambda c, s: c,
    ),
    Kind(
        "order of joints", ("joint order",), lambda c, s, g: put.swapped(c, ("q", "dq"), int(s)), states=lambda c, s: c
    ),
    Kind(
        "delay of torque [samples]",
        ("torque delay",),
        lambda c, s, g: put.delayed(c, s),
        (0.01, 50.0),
        of_all=True,
        states=lambda c, s: s * put.step_of(c),
    ),
    Kind(
        "spring [of torque]",
        ("spring",),
        lambda c, s, g: put.sprung(c, s, 0),
        (1e-3, 1.0),
        joint=lambda c, s: 0,
        states=lambda c, s: s * put.spreads(c, "tau")[0] / put.spreads(c, "q")[0],
    ),
    Kind(
        "counterbalance [of torque]",
        ("counterbalance", "spring"),
        put.balanced,
        (1e-3, 1.0),
        joint=lambda c, s: put.heaviest(c),
        states=lambda c, s: s * put.spreads(c, "tau").max(),
    ),
    Kind(
        "drift [of torque]",
        ("drift",),
        put.drifting,
        (1e-3, 2.0),
        joint=lambda c, s: put.heaviest(c),
        states=lambda c, s: s * put.spreads(c, "tau").max(),
    ),
    Kind("friction warms up [of torque]", ("friction drift",), put.warming, (1e-3, 1.0)),
    Kind(
        "torque scale of a joint [share]",
        ("torque scale",),
        lambda c, s, g: put.scaled(c, s, 1),
        (1e-3, 1.0),
        joint=lambda c, s: 1,
        states=lambda c, s: 1 + s,
    ),
    Kind(
        "torque scale of all [share]",
        ("torque unit", "torque scale"),
        lambda c, s, g: put.scaled(c, s),
        (1e-3, 1.0),
        of_all=True,
        states=lambda c, s: 1 + s,
    ),
    Kind(
        "current for torque [A per N m]",
        ("torque unit",),
        lambda c, s, g: put.scaled(c, 1 / s - 1),
        fixed=(5.0, 11.0, 100.0),
        why="drive gains are what they are",
        states=lambda c, s: 1 / s,
    ),
    Kind(
        "gear ratio forgotten",
        ("torque scale", "scale not determined"),
        lambda c, s, g: put.scaled(c, 1 / 50 - 1, int(s)),
        fixed=(1, 2, 3),
        joint=lambda c, s: int(s),
        states=lambda c, s: 1 / 50,
    ),
    Kind("payload [kg]", ("load at the flange",), put.loaded, (1e-3, 50.0), states=lambda c, s: s),
    Kind(
        "mounting [variant]",
        ("mounting",),
        lambda c, s, g: put.mounted(c, int(s)),
        fixed=(0, 1, 2),
        states=lambda c, s: np.asarray(c.case.robot.gravity),
    ),
    Kind("another arm [variant]", ("another robot",), lambda c, s, g: put.other_arm(c, int(s)), fixed=(0, 1, 2)),
    Kind(
        "tilt of the base [deg]",
        ("tilt", "mounting"),
        put.tilted,
        (1e-3, 20.0),
        states=lambda c, s: np.asarray(c.case.robot.gravity),
    ),
    Kind("poor excitation [rad]", ("poor excitation",), put.poor, fixed=(0.1, 0.3, 0.6), why="it replaces the motion"),
    Kind("speed scaling", ("speed scaling",), put.slowed, fixed=(0.9, 0.7, 0.3), why="positions are the measured ones"),
)
