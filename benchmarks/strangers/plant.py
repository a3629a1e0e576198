"""A plant of its own: Pinocchio's dynamics in a closed loop, drives whose motors may turn with several joints."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Array = Any

#: Steps of the integration a second at least.
STEPS = 2000.0

#: Speed over which the sign of dry friction turns, rad/s or m/s.
WIDTH = 0.004

Motion = Callable[[Array], tuple[Array, Array, Array]]


@dataclass(frozen=True)
class Body:
    """A joint and the link behind it, in SI units."""

    joint: str
    place: Sequence[float]
    axis: Sequence[float]
    limits: tuple[float, float]
    speed: float
    effort: float
    mass: float
    centre: Sequence[float]
    inertia: Sequence[float]
    turned: Sequence[float] = (0.0, 0.0, 0.0)
    kind: str = "revolute"


@dataclass(frozen=True)
class Drives:
    """Drives, each value one for all or one per motor; torques are those at the joints where nothing is coupled."""

    rotor: Any
    coulomb: Any
    viscous: Any
    break_away: Any = 0.0
    load: float = 0.0
    bend: Any = 0.0
    coupling: Any = None

    def of(self, joints: int) -> dict[str, Array]:
        names = ("rotor", "coulomb", "viscous", "break_away", "bend")
        return {name: np.broadcast_to(np.asarray(getattr(self, name), float), (joints,)) for name in names}


@dataclass(frozen=True)
class Run:
    """What happened, row by row, shape (N, n) but for the time."""

    time: Array
    q: Array
    dq: Array
    at_sensors: Array
    at_motors: Array
    wanted: Array


def cylinder(mass: float, radius: float, length: float, axis: int) -> list[float]:
    """Return the moments of inertia of a cylinder along an axis."""
    along, across = mass * radius**2 / 2, mass * (3 * radius**2 + length**2) / 12
    return [along if k == axis else across for k in range(3)]


def urdf(name: str, bodies: Sequence[Body], seed: int | None = None) -> str:
    """Return the robot model; with a seed that of a robot whose bodies are drawn about the described ones."""
    generator = None if seed is None else np.random.default_rng(seed)
    parts, parent = [f'<robot name="{name}">', '<link name="base_link"/>'], "base_link"
    for k, body in enumerate(bodies):
        mass, centre, inertia = body.mass, np.array(body.centre, float), np.diag(np.array(body.inertia, float))
        if generator is not None:
            mass, centre, inertia = _drawn(generator, mass, centre, inertia)
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertia
        moments = f'ixx="{xx:.9g}" ixy="{xy:.9g}" ixz="{xz:.9g}" iyy="{yy:.9g}" iyz="{yz:.9g}" izz="{zz:.9g}"'
        low, high = body.limits
        kind = body.kind if generator is None or body.kind != "continuous" else "revolute"
        bounds = "" if body.kind == "continuous" and generator is None else f'lower="{low}" upper="{high}" '
        parts += [
            f'<link name="link_{k + 1}"><inertial><origin xyz="{_row(centre)}" rpy="0 0 0"/><mass value="{mass:.9g}"/>',
            f"<inertia {moments}/></inertial></link>",
            f'<joint name="{body.joint}" type="{kind}"><parent link="{parent}"/><child link="link_{k + 1}"/>',
            f'<origin xyz="{_row(body.place)}" rpy="{_row(body.turned)}"/><axis xyz="{_row(body.axis)}"/>',
            f'<limit {bounds}velocity="{body.speed}" effort="{body.effort}"/></joint>',
        ]
        parent = f"link_{k + 1}"
    return "\n".join([*parts, "</robot>"])


def _row(values: Any) -> str:
    return " ".join(f"{float(value):.15g}" for value in values)


def _drawn(generator: np.random.Generator, mass: float, centre: Array, inertia: Array) -> tuple[float, Array, Array]:
    """Return a possible body near another one: second moments stay those of a mass."""
    factor = float(np.exp(generator.normal(0, 0.15)))
    centre = centre + generator.normal(0, 0.012, 3)
    spread = np.linalg.cholesky(0.5 * np.trace(inertia) * np.eye(3) - inertia + 1e-9 * np.eye(3))
    spread = spread * np.exp(generator.normal(0, 0.1, (3, 3)))
    turn = np.linalg.qr(np.eye(3) + generator.normal(0, 0.1, (3, 3)))[0]
    second = factor * turn @ spread @ spread.T @ turn.T
    return mass * factor, centre, np.trace(second) * np.eye(3) - second


def waves(bodies: Sequence[Body], first: float, count: int, seed: int, reach: Any, middle: Any, share: float) -> Motion:
    """Return a motion of ``count`` harmonics of ``first`` Hz that begins at rest, within reach and a share of speed."""
    generator = np.random.default_rng(seed)
    pulsation = 2 * np.pi * first * np.arange(1, count + 1)
    a, b = generator.normal(size=(2, len(bodies), count)) / np.sqrt(np.arange(1, count + 1))

    def raw(t: Array) -> tuple[Array, Array, Array]:
        sine, cosine = np.sin(pulsation * t[:, None, None]), np.cos(pulsation * t[:, None, None])
        q, dq = (a * sine + b * cosine).sum(-1), ((a * cosine - b * sine) * pulsation).sum(-1)
        return q, dq, -((a * sine + b * cosine) * pulsation**2).sum(-1)

    q, dq, _ = raw(np.linspace(0, 1 / first, 2000))
    centre = 0.5 * (q.max(0) + q.min(0))
    speed = share * np.array([body.speed for body in bodies])
    scale = np.minimum(np.asarray(reach) / (0.5 * np.ptp(q, axis=0)), speed / np.abs(dq).max(0))

    def motion(t: Array) -> tuple[Array, Array, Array]:
        t = np.atleast_1d(t)
        q, dq, ddq = ((value - shift) * scale for value, shift in zip(raw(t), (centre, 0, 0), strict=True))
        x = np.clip(t / 3.0, 0, 1)[:, None]
        u, du, ddu = x**3 * (10 - 15 * x + 6 * x**2), 10 * x**2 * (1 - x) ** 2, 60 * x * (1 - x) * (1 - 2 * x) / 9
        return q * u + middle, dq * u + q * du, ddq * u + 2 * dq * du + q * ddu

    return motion


def run(
    truth: str, motion: Motion, seconds: float, rate: float, drives: Drives, gravity: Sequence[float] = (0, 0, -9.81)
) -> Run:
    """Return what a robot does under computed torque and feedback, at the rate of the log or 1 kHz."""
    import pinocchio  # the bodies alone need none

    model = pinocchio.buildModelFromXML(truth)
    model.gravity.linear = np.array(gravity, float)
    data, joints = model.createData(), model.nv
    own = drives.of(joints)
    c = np.eye(joints) if drives.coupling is None else np.array(drives.coupling, float)
    rotors = c.T @ np.diag(own["rotor"]) @ c
    inner = max(1, int(np.ceil(STEPS / rate)))
    step, time = 1 / (rate * inner), np.arange(int(seconds * rate)) / rate
    held = inner if rate >= 1000 else max(1, int(inner * rate / 1000))
    q, dq = motion(np.zeros(1))[0][0].copy(), np.zeros(joints)
    masses = np.diag(pinocchio.crba(model, data, q)).copy() + np.diag(rotors)
    stiff, damp = masses * 80 * 1.6**2, 1.6 * masses * 80**0.5 * 1.6
    fine = np.arange(len(time) * inner) * step
    plans = motion(fine[::held])
    rows: dict[str, list[Array]] = {name: [] for name in ("q", "dq", "at_sensors", "at_motors")}
    tau = np.zeros(joints)
    for k in range(len(fine)):
        if k % held == 0:
            aim, speed, push = (plan[k // held] for plan in plans)
            wanted = pinocchio.rnea(model, data, q, dq, push) + rotors @ push + stiff * (aim - q) + damp * (speed - dq)
            plain = own["coulomb"] * np.tanh(c @ speed / 0.02) + own["viscous"] * (c @ speed)
            tau = np.linalg.solve(c.T, wanted) + plain
        turned = c @ dq
        dry = own["coulomb"] + own["break_away"] * np.exp(-((turned / 0.05) ** 2)) + drives.load * np.abs(tau)
        friction = np.tanh(turned / WIDTH) * dry + own["viscous"] * turned + own["bend"] * np.arctan(turned / 0.4)
        upper = np.triu(pinocchio.crba(model, data, q))
        inertia = upper + np.triu(upper, 1).T + rotors
        forces = c.T @ (tau - friction) - pinocchio.nonLinearEffects(model, data, q, dq)
        slope = own["coulomb"] / WIDTH * (1 - np.tanh(turned / WIDTH) ** 2) + own["viscous"]
        ddq = np.linalg.solve(inertia + step * c.T @ (slope[:, None] * c), forces)
        if k % inner == 0:
            sensors = (inertia - rotors) @ ddq + pinocchio.nonLinearEffects(model, data, q, dq)
            for name, value in zip(rows, (q, dq, sensors, tau), strict=True):
                rows[name].append(value.copy())
        dq = dq + step * ddq
        q = q + step * dq
    found = {name: np.array(values) for name, values in rows.items()}
    if rate >= 1000:  # held over a row: its middle is half a row late
        motors = found["at_motors"]
        found["at_motors"] = 0.5 * (motors + np.vstack([motors[:1], motors[:-1]]))
    return Run(time, found["q"], found["dq"], found["at_sensors"], found["at_motors"], motion(time)[0])
