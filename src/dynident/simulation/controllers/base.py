"""What a controller of the virtual cell is: options, a table of numbers, and a compiled law with a memory.

A law is called once a tick of the controller, as

    law(settings, goal, seen, robot, memory, work, tau)

with settings (s, n), what :meth:`Controller.settings` made of the options; goal (5, n), the commanded q, dq and ddq,
the torque fed forward, and what the drives give beside the bodies there (believed friction where it is fed forward,
less the known bias); seen (2, n), the measured q and dq; robot, three things: limits (n,), the largest torques,
infinite for none; the time between two ticks in s; and what the controller believes of the robot: links, reals,
gravity and theta as in :mod:`dynident.model.kernels.generic`, and the rotor inertia at the joints (n, n);
memory (m, n), zeros at the start, its own to write; work, scratch of the kernels; and it writes tau (n,), the
torque at the joints. The cell cuts it at the limits and holds it until the next tick. The first row of the
memory is that of the ticks: it is 0, 1, 2, ... in all columns.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, Literal

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.simulation.effects import each

FEEDS = ("none", "gravity", "model")

#: Natural frequency of joint loops, in Hz, where the motion asks for no higher one.
USUAL_HZ = 8.0

#: Halvings of the share of the damping that the rate of the controller allows.
_HALVINGS = 12

#: Decay of a loop, per time until a measurement acts, up to which a controller chooses its gains.
SAFE = 0.8


@dataclass(frozen=True)
class Loop:
    """What is known of the joints when gains are chosen.

    Attributes:
        inertia: Diagonal of the mass matrix with the rotors at the start, shape (n,), in kg m^2 or kg.
        masses: Mass matrices that a fast torque moves along the motion, shape (N, n, n).
        dead: Time in s until a measurement acts: tick, delay and lag of the current loops.
        friction: Least slope of friction over speed, shape (n,), in N m s/rad or N s/m.
        wanted: Natural frequency of each joint's loop, in rad/s, at which what nobody feeds forward (friction, or the
            bodies' own inertia) displaces the joint by a small share of its motion, shape (n,).
    """

    inertia: Array
    masses: Array
    dead: float
    friction: Array
    wanted: Array

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return len(self.inertia)

    def decay(self, damping: Array) -> float:
        """Return the fastest decay along the motion, per time until a measurement acts, of damping (n,) by feedback."""
        return self.dead * float(np.max(np.abs(np.linalg.eigvals(np.linalg.solve(self.masses, np.diag(damping))))))

    @property
    def stiffest(self) -> float:
        """Natural frequency, in rad/s, of joint loops of unit damping whose :meth:`decay` is 1; half of it is safe."""
        return 1.0 / self.decay(2.0 * self.inertia)

    def pulsation(self, bandwidth_hz: float | None, usual_hz: float) -> float:
        """Return a natural frequency in rad/s: the one given in Hz, or the usual one where the rate allows it."""
        if bandwidth_hz is not None:
            return 2.0 * np.pi * bandwidth_hz
        return min(2.0 * np.pi * usual_hz, SAFE * self.stiffest)


@dataclass(frozen=True)
class Controller(ABC):
    """A sampled joint controller; the fields of a part are its options.

    Attributes:
        rate: Ticks a second, in Hz.
        delay_s: Time from the measurement until the torque acts, in s.
        current_hz: Corner frequency of the closed current loops (first order): how fast torque follows its command;
            none for at once.
        feedforward: Torque along the commanded motion that is added: ``none``, ``gravity``, or all of the ``model``
            that the controller believes.
    """

    #: Rows of the memory, the one of the ticks included.
    memory: ClassVar[int] = 1

    rate: float = field(default=1000.0, kw_only=True)
    delay_s: float = field(default=0.0, kw_only=True)
    current_hz: float | None = field(default=None, kw_only=True)
    feedforward: Literal["none", "gravity", "model"] = field(default="gravity", kw_only=True)

    def __post_init__(self) -> None:
        if self.feedforward not in FEEDS:
            raise BadOption("controller.feedforward", self.feedforward, f"choose one of: {', '.join(FEEDS)}")
        for one in fields(self):
            value = getattr(self, one.name)
            if value is None or isinstance(value, str):
                continue
            lowest = 0.0 if one.name == "delay_s" or one.name in self.may_be_zero else np.nextafter(0.0, 1.0)
            if not np.all((np.array(value, dtype=np.float64) >= lowest) & np.isfinite(value)):
                words = "a finite number, 0 or more" if lowest == 0 else "a number above 0"
                raise BadOption(f"controller.{one.name}", value, f"give {words}")

    #: Options that may be 0.
    may_be_zero: ClassVar[tuple[str, ...]] = ()

    def plain_gains(self) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
        """Return stiffness and damping where these two, both stated, are all of its feedback; None as a rule."""
        return None

    @abstractmethod
    def law(self) -> Callable[..., Any]:
        """Return the compiled law; see the head of the file."""

    @abstractmethod
    def settings(self, loop: Loop) -> Array:
        """Return the numbers of the law, shape (s, n)."""


def following(loop: Loop, damping_ratio: float) -> tuple[Array, Array]:
    """Return stiffness and damping, each (n,), at which each joint follows its motion, as far as the rate allows it.

    They are the usual ones, and higher where friction or inertia would hold a joint back. Friction damps as well: what
    it gives at any speed of the motion is left out of the feedback, which would be too fast for the ticks on a light
    joint. Where the ticks allow less damping than that, the joint is less stiff: its damping ratio is 0.5 or more.
    """
    usual = loop.pulsation(None, USUAL_HZ)
    wanted = np.maximum(usual, np.minimum(loop.wanted, 0.5 / loop.dead))
    least = 2.0 * damping_ratio * usual * loop.inertia
    room = np.maximum(2.0 * damping_ratio * wanted * loop.inertia - loop.friction, least) - least
    low, high = 0.0, 1.0
    if loop.decay(least + room) <= SAFE:
        low = 1.0
    else:
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if loop.decay(least + middle * room) <= SAFE else (low, middle)
    damping = least + low * room
    pulsation = np.maximum(usual, np.minimum(wanted, (damping + loop.friction) / loop.inertia))
    return pulsation**2 * loop.inertia, damping


def gains(part: Any, loop: Loop) -> tuple[Array, Array]:
    """Return stiffness and damping, each (n,), of a part with the options of :class:`Pd`."""
    if part.bandwidth_hz is None:
        stiffness, damping = following(loop, part.damping_ratio)
    else:
        pulsation = loop.pulsation(part.bandwidth_hz, USUAL_HZ)
        stiffness, damping = pulsation**2 * loop.inertia, 2.0 * part.damping_ratio * pulsation * loop.inertia
    if part.stiffness is not None:
        stiffness = each("controller.stiffness", part.stiffness, loop.joints)
    if part.damping is not None:
        damping = each("controller.damping", part.damping, loop.joints)
    return stiffness, damping
