"""From the payload's ten and their covariance to a statement: intervals, verdicts, the possible body behind them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.applications.payload.carried_load import (
    IDENTIFIED,
    IMPOSSIBLE,
    NOT_DETERMINED,
    WEAK,
    CarriedLoad,
    LoadParameter,
)
from dynident.applications.payload.flanges import likeliest
from dynident.applications.payload.gain_doubt import GainDoubt
from dynident.arrays import Array, BoolArray
from dynident.errors import SolverFailed
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.residuals.quantiles import chi_square_tail, student_quantile
from dynident.model.inertia import PSEUDO_BASIS, TEN, Inertia

#: By how much payloads of one mass differ: lever of the centre of mass and radius of gyration, in m; above a mass in kg
#: radii grow with its cube root, as those of bodies of one density do.
LENGTH, LIGHT = 0.1, 5.0

#: Half an interval may reach this share of it, for the mass of the mass itself, and still count as identified.
SHARE = 0.5

#: Torque that is left with the payload, as a multiple of that of the fit, from which on the payload explains nothing.
FAR = 10.0

#: Half widths of 95 % from the mass by the log alone beyond which a stated one contradicts it: three deviations.
APART = 1.5

#: Share of the torque without the payload (of all joints) that is left with it where far more than by the fit is left:
#: above it the run has something else than a payload.
LEFT = 0.1

#: Chance of a body as far from the ten by noise alone below which it is said.
UNLIKELY = 0.001

UNITS = (*["kg m^2"] * 6, *["kg m"] * 3, "kg")


@dataclass(frozen=True)
class PayloadFit:
    """What the fit has found of a payload.

    Attributes:
        ten: In the frame of the flange, shape (10,).
        open: Which of them no row determines, shape (10,).
        parts: Covariance by source, shape (10, 10) each.
        degrees: Degrees of freedom of each variance by noise, shape (10,).
        place: Link that carries it, and the pose of the flange in its frame.
        rows: ``motion`` or ``poses``.
        samples: Rows used.
        residual: Root mean square torque that is left without and with the payload, shape (n,) each.
        gains: Doubt about drive gains; None where no torque is made of one, or they are said to be exact.
        better: Another link, on which a payload explains the torques far better, and what is left then, shape (n,);
            None where the payload explains them, or no other link does.
        loads: Least and largest load of parts of the logs, in kg; None where the load may be one.
    """

    ten: Array
    open: BoolArray
    parts: Mapping[str, Array]
    degrees: Array
    place: tuple[int, Array, Array]
    rows: str
    samples: int
    residual: tuple[Array, Array]
    gains: GainDoubt | None = None
    better: tuple[int, Array] | None = None
    loads: tuple[float, float] | None = None


def stated(
    found: PayloadFit,
    estimate: Estimate,
    frame: str,
    level: float,
    logs: tuple[str, ...],
    remarks: tuple[str, ...] = (),
    free: PayloadFit | None = None,
) -> CarriedLoad:
    """Return the payload with its intervals and verdicts, in a frame of which ``remarks`` tell how it was chosen.

    With a stated mass the fit that is ``free`` of it tells what torque no payload explains.
    """
    unexplained_torque, contradiction = _unexplained(free or found, estimate)
    robot = estimate.model.robot
    closed = np.outer(~found.open, ~found.open)
    covariance = np.where(closed, sum(found.parts.values()), 0.0)
    degrees = _degrees(found, np.where(found.open, np.inf, np.maximum(np.diag(covariance), 1e-300)))
    quantile = student_quantile(0.5 + 0.5 * level, degrees)
    half = np.where(found.open, np.inf, np.sqrt(np.diag(covariance)) * quantile)
    mass = float(found.ten[9])
    radius = LENGTH * max(1.0, abs(mass) / LIGHT) ** (1 / 3)
    sizes = abs(mass) * np.r_[np.full(6, radius**2), np.full(3, radius), 1.0]
    parameters = tuple(
        _parameter(name, value, width, unit, SHARE * size)
        for name, value, width, unit, size in zip(TEN, found.ten, half, UNITS, sizes, strict=True)
    )
    if parameters[9].label == IMPOSSIBLE:
        parameters = tuple(replace(one, label=IMPOSSIBLE) if np.isfinite(one.half_width) else one for one in parameters)
    body, distance = _body(found, covariance)
    link, rotation, translation = found.place
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = rotation, translation
    pairs = zip(robot.joint_names, *found.residual, strict=True)
    load = CarriedLoad(
        frame=frame,
        link=robot.links[link].name,
        placement=placement,
        parameters=parameters,
        centre=_centre(found, covariance, quantile),
        covariance=covariance,
        parts={name: float(np.sqrt(max(part[9, 9], 0.0))) for name, part in found.parts.items()},
        body=body,
        distance=distance,
        rows=found.rows,
        samples=found.samples,
        level=level,
        residual={name: (float(without), float(with_it)) for name, without, with_it in pairs},
        logs=logs,
        remarks=(*remarks, *_remarks(found, estimate, parameters, distance, unexplained_torque)),
    )
    return load.contradicted(contradiction)


def _degrees(found: PayloadFit, total: Array) -> Array:
    """Return the degrees of freedom of variances of which that by noise and by gains are doubted (Satterthwaite)."""
    degrees = np.inf if found.gains is None else found.gains.degrees
    noise, gains = (np.minimum(np.diag(found.parts[name]) / total, 1.0) for name in ("noise", "gains"))
    return 1.0 / np.maximum(noise**2 / found.degrees + gains**2 / degrees, 1e-12)


def _parameter(name: str, value: float, half: float, unit: str, enough: float) -> LoadParameter:
    if not np.isfinite(half):
        return LoadParameter(name, np.nan, np.inf, unit, NOT_DETERMINED)
    if name == "m" and value <= 0:
        return LoadParameter(name, float(value), float(half), unit, IMPOSSIBLE if value + half < 0 else WEAK)
    return LoadParameter(name, float(value), float(half), unit, IDENTIFIED if half <= enough else WEAK)


def _centre(found: PayloadFit, covariance: Array, quantile: Array) -> tuple[LoadParameter, ...]:
    """Return the centre of mass h / m with intervals to first order."""
    mass = float(found.ten[9])
    result = []
    for axis in range(3):
        k = 6 + axis
        if found.open[k] or found.open[9] or mass <= 0:
            result.append(_parameter(f"c{'xyz'[axis]}", np.nan, np.inf, "m", 0.0))
            continue
        value = float(found.ten[k]) / mass
        slope = np.zeros(10)
        slope[k], slope[9] = 1.0 / mass, -value / mass
        half = float(np.sqrt(slope @ covariance @ slope) * quantile[k])
        result.append(_parameter(f"c{'xyz'[axis]}", value, half, "m", SHARE * LENGTH))
    return tuple(result)


def _body(found: PayloadFit, covariance: Array) -> tuple[Inertia, float]:
    """Return the possible body nearest to the ten, and how many standard deviations away it is in all."""
    sizes = np.r_[np.full(6, LENGTH**2), np.full(3, LENGTH), 1.0]
    closed = np.flatnonzero(~found.open)
    information = np.zeros((10, 10))
    scaled = covariance[np.ix_(closed, closed)] / sizes[closed] / sizes[closed][:, None]
    values, vectors = np.linalg.eigh(scaled)
    kept = values > 1e-14 * max(float(values[-1]), 1e-300) if len(values) else np.zeros(0, bool)
    inner = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    information[np.ix_(closed, closed)] = inner / sizes[closed] / sizes[closed][:, None]
    spread = float(np.sqrt(covariance[9, 9]))
    mass = 1.0 if found.open[9] else max(float(found.ten[9]), 0.1 * spread, 1e-3)
    centre = np.where(found.open[6:9], 0.0, found.ten[6:9]) / mass
    reach = float(np.linalg.norm(centre))
    centre = centre * min(1.0, 5 * LENGTH / reach) if reach else centre
    ball = Inertia.from_centre_of_mass(mass, centre, 0.4 * mass * LENGTH**2 * np.eye(3))
    body = possible_body(np.where(found.open, 0.0, found.ten), information, ball)
    away = np.where(found.open, 0.0, body.vector - found.ten)
    return body, float(np.sqrt(max(away @ information @ away, 0.0)))


def unexplained(without: Array, left: Array, estimate: Estimate) -> int | None:
    """Return the joint of which a payload leaves far more torque than the fit of the robot did; None for none.

    Args:
        without: Root mean square torque that is left without the payload, shape (n,).
        left: The same with it, shape (n,).
        estimate: The robot.
    """
    usual = np.maximum(np.asarray(estimate.joint_deviations), 1e-300)
    worst = int(np.argmax(left / usual))
    return worst if left[worst] > FAR * max(usual[worst], 1e-3 * without[worst]) else None


def _torque_left(found: PayloadFit, estimate: Estimate) -> tuple[int, str] | None:
    """Return the joint of which the payload leaves far more torque than the fit of the robot did, with words for it."""
    worst, left = unexplained(*found.residual, estimate), found.residual[1]
    if found.rows != "motion" or worst is None:
        return None
    joint = estimate.model.robot.active[worst]
    text = f"no payload explains the torque of {joint.name}: {left[worst]:.3g} {joint.unit} are left, "
    return worst, text + f"{estimate.joint_deviations[worst]:.3g} by the fit of the robot; intervals do not hold then"


def _unexplained(found: PayloadFit, estimate: Estimate) -> tuple[list[str], str]:
    """Return remarks on torque that the payload leaves, and why no payload is what the run has more than the robot.

    For that all joints count together: one that the payload hardly loads may have another reason, as a hose at a wrist.
    A payload on another link that explains the torques far better is a reason as well.
    """
    left = _torque_left(found, estimate)
    if left is None:
        return [], ""
    (worst, told), robot = left, estimate.model.robot
    joint, remarks = robot.active[worst], [told]
    if found.better is not None:
        link, rest = found.better
        own = robot.links[link].name
        flange = next(iter(likeliest([name for name, frame in robot.frames.items() if frame.link == link])), own)
        text = f"a payload on {own} explains the torques far better, that of {joint.name} to {rest[worst]:.3g} "
        told = (
            f"{text}{joint.unit}: --flange {flange}; or the mounting or a zero is not that of the fit "
            "('dynident check CASE LOG --against ESTIMATE' looks)"
        )
        return [told, *remarks], told
    before, after = map(np.linalg.norm, found.residual)
    return remarks, told if after > LEFT * before else ""


def disagreement(mass: float, deviation: float, alone: LoadParameter) -> str:
    """Return what is to be said of a stated mass in kg beside another one that the log alone tells; empty for nothing.

    Args:
        mass: The stated mass, in kg.
        deviation: Its standard deviation, in kg.
        alone: The mass by the log alone, with its 95 % interval.
    """
    allowed = APART * float(np.hypot(alone.half_width, 2.0 * deviation))
    if not np.isfinite(allowed) or abs(alone.value - mass) <= allowed:
        return ""
    weighed = f"{alone.value:.4g} kg (+- {alone.half_width:.2g})"
    told = f"the log alone weighs {weighed}, which contradicts the stated {mass:g} kg"
    return f"{told}: weigh it again or leave --mass out; wrong drive gains do the same ('dynident gains' finds them)"


def mass_doubt(mass: LoadParameter) -> str:
    """Return what is to be said of a mass that is below 0 or may be 0; empty where it is neither."""
    if np.isfinite(mass.half_width) and mass.value + mass.half_width < 0:
        return (
            "no payload has a mass below 0: the log may be of another robot or mounting, or the robot was identified "
            "with a load; look at units, signs and order of its columns"
        )
    return (
        "the mass is not significant at 95 %: no payload is evident" if mass.value <= mass.half_width < np.inf else ""
    )


def _remarks(
    found: PayloadFit,
    estimate: Estimate,
    parameters: tuple[LoadParameter, ...],
    distance: float,
    unexplained_torque: Sequence[str],
) -> tuple[str, ...]:
    remarks = list(filter(None, [mass_doubt(parameters[9])]))
    if found.loads is not None:
        low, high = found.loads
        text = f"the load is not the same all along: {low:.2g} to {high:.2g} kg in parts of the log; "
        remarks.append(text + "'dynident track ESTIMATE LOG' finds when it changes")
    remarks += unexplained_torque
    count = int(np.sum(~found.open))
    if count and chi_square_tail(distance**2, count) < UNLIKELY:
        text = f"no body is as found: the nearest is {distance:.3g} standard deviations away; friction or drive gains "
        remarks.append(text + "may have changed, or the payload may have moved")
    drives = [joint.drive for joint in estimate.model.robot.active]
    if found.gains is None and any(drive.gain is not None for drive in drives):
        remarks.append("drive gains are taken for exact: one that is 10 % off makes the mass up to 10 % wrong; "
                       "see 'dynident gains'")  # fmt: skip
    elif found.gains is not None and np.isfinite(found.gains.degrees):
        share = 100.0 * float(found.gains.deviations.max())
        text = f"joints disagree about the payload as drive gains do that are off by {share:.2g} % each; "
        remarks.append(text + "what all gains have in common is not seen: 'dynident gains' finds it with a known mass")
    if found.rows == "poses":
        remarks.append("postures tell mass and centre of mass only; a motion tells the inertia as well")
    return tuple(remarks)


#: Weight of the pull towards the prior body; a datum of one standard deviation weighs 1.
PULL = 0.01

#: The pull is lowered to its weight in such steps from where Newton's method is sure to converge.
LOWERED, HIGHEST = 10.0, 1e6

#: Newton steps for one weight at most, decrement below which they end, and one that no noise tells from 0.
STEPS, DONE, FAIR = 100, 1e-13, 0.1

#: Least share of the prior that the start has along each direction.
THIN = 1e-3


def possible_body(ten: Array, information: Array, prior: Inertia) -> Inertia:
    """Return the body with min (x - ten)' information (x - ten) / 2 + PULL D(P(x), P(prior)) among all with P > 0.

    D is the entropic divergence tr(P0^-1 P) - log det(P0^-1 P) - 4 (Lee, Wensing and Park 2020): a barrier at the edge
    of what is possible, and where the data say nothing the prior. Newton's method along falling weights of D.

    Args:
        ten: Found parameters in the order of TEN, shape (10,).
        information: Inverse covariance, zero in directions that are not determined, shape (10, 10).
        prior: A possible body.

    Raises:
        SolverFailed: Newton's method did not converge.
    """
    found = _BodyObjective(ten, information, prior)
    x, weight = found.start(), HIGHEST
    while weight > PULL:
        x = found.nearest(x, weight, sure=False)
        weight /= LOWERED
    return Inertia.from_vector(found.nearest(x, PULL, sure=True))


class _BodyObjective:
    """The objective in coordinates in which the prior is the unit matrix."""

    def __init__(self, ten: Array, information: Array, prior: Inertia) -> None:
        self.ten, self.information = ten, information
        self.root = np.linalg.cholesky(prior.pseudo)
        inverse = np.linalg.inv(self.root)
        self.basis = inverse @ PSEUDO_BASIS @ inverse.T
        self.linear = np.trace(self.basis, axis1=1, axis2=2)
        self.size = np.sqrt(np.einsum("kij,kij->k", self.basis, self.basis))

    def start(self) -> Array:
        """Return the ten with the eigenvalues of their pseudo-inertia lifted above zero."""
        values, vectors = np.linalg.eigh(np.einsum("k,kij->ij", self.ten, self.basis))
        lifted = self.root @ (vectors * np.maximum(values, THIN)) @ vectors.T @ self.root.T
        return Inertia.from_pseudo(lifted).vector

    def value(self, x: Array, pull: float) -> float:
        """Return the objective; infinite where x is no possible body."""
        values = np.linalg.eigvalsh(np.einsum("k,kij->ij", x, self.basis))
        if values[0] <= 0:
            return np.inf
        away = x - self.ten
        return float(0.5 * away @ self.information @ away + pull * (self.linear @ x - np.sum(np.log(values))))

    def nearest(self, x: Array, pull: float, sure: bool) -> Array:
        """Return the minimum for one weight of D from a start inside."""
        now, decrement = self.value(x, pull), np.inf
        for _ in range(STEPS):
            inside = np.linalg.inv(np.einsum("k,kij->ij", x, self.basis))
            parts = inside @ self.basis
            slope = self.information @ (x - self.ten) + pull * (self.linear - np.trace(parts, axis1=1, axis2=2))
            bend = self.information + pull * np.einsum("iab,jba->ij", parts, parts)
            step = -np.linalg.solve(bend / self.size / self.size[:, None], slope / self.size) / self.size
            decrement = float(-slope @ step)
            if decrement <= DONE * max(1.0, abs(now)):
                return x
            length = 1.0
            while not self.value(x + length * step, pull) <= now - 1e-4 * length * decrement and length > 1e-12:
                length *= 0.5
            if length <= 1e-12:
                return x  # the objective cannot tell anything smaller
            x = x + length * step
            now = self.value(x, pull)
        if sure and not decrement <= FAIR:
            evidence = f"a decrement of {decrement:.2g} is left"
            raise SolverFailed("the possible payload", evidence, "check the units of the log")
        return x
