"""Friction of the drives as tables over speed that a compiled loop looks up; any part that depends on speed alone fits.

A torque over speed is tabulated over s = asinh(v / FINEST), a cubic in each cell through its value at four points: tanh
of the usual widths is met to 1e-10 of its height, powers of v to 1e-9. What a part adds per degree and per newton
metre of load has tables of its own; rotor inertia is none of friction, and torque that repeats with position is kept as
sines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.experiment.simulation.cell_loop import BASE, CELL, CELLS, FINEST, LOAD
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Friction, Motion
from dynident.model.friction.periodic import Periodic

#: A width so narrow that its tanh is the sharp sign at every speed of a table.
SHARP = 1e-15


@dataclass(frozen=True)
class FrictionTables:
    """Friction of n drives with numbers.

    Attributes:
        smooth: Cubics of the torque over speed, shape (3, n, CELLS, 4); the first index as BASE, HEAT, LOAD, the last
            of which is left out where no friction depends on the load.
        dry: The same for the dry friction with a sharp sign, which ``smooth`` then lacks; shape (0, n, CELLS, 4)
            where the smooth signs stand for it.
        waves: Sines of the position, shape (w, 4): drive, cycles, and the factors of sine and cosine.
        rotor: Identified rotor inertia of each drive, shape (n,), in kg m^2 or kg.
        breakaway: Dry friction at the least speed, the mean of both directions, shape (n,); 0 without bristles.
    """

    smooth: Array
    dry: Array
    waves: Array
    rotor: Array
    breakaway: Array

    def steepest(self, fastest: Array) -> Array:
        """Return the steepest rise of the smooth torque over speed up to the speeds (n,), shape (n,), in N m s/rad."""
        speed, cubics = node_speeds(), self.smooth[BASE]
        rise = np.abs(_end(cubics) - cubics[..., 0]) / (speed[:, 3] - speed[:, 0])
        within = np.min(np.abs(speed), axis=1) <= fastest[:, None]
        return np.max(np.where(within, rise, 0.0), axis=1)

    def gentlest(self, fastest: Array) -> Array:
        """Return the least rise of the smooth torque over speed up to the speeds (n,), 0 or more, shape (n,)."""
        speed, cubics = node_speeds(), self.smooth[BASE]
        rise = (_end(cubics) - cubics[..., 0]) / (speed[:, 3] - speed[:, 0])
        within = np.min(np.abs(speed), axis=1) <= fastest[:, None]
        return np.maximum(np.min(np.where(within, rise, np.inf), axis=1), 0.0)

    def least_dry(self, fastest: Array) -> Array:
        """Return the least dry friction at any speed up to the speeds (n,), shape (n,), in N m or N."""
        if not len(self.dry):
            return np.zeros(len(fastest))
        size = np.abs(np.stack([self.dry[BASE, ..., 0], _end(self.dry[BASE])]))
        within = np.min(np.abs(node_speeds()), axis=1) <= fastest[:, None]
        return np.min(np.where(within, size, np.inf), axis=(0, 2))


def friction_tables(model: DynamicModel, theta: Array, start: Array, bristles: bool) -> FrictionTables:
    """Return the friction of a model with the parameters theta (p,).

    Args:
        model: Robot and friction.
        theta: All its parameters, shape (p,).
        start: Temperature at which the tables hold, shape (n,), in degrees Celsius.
        bristles: Whether dry friction is kept apart, for bristles.

    Raises:
        BadOption: A sharp sign without bristles, or a part that depends on more than speed, load and temperature.
    """
    n = model.robot.dof
    coefficients = model.coefficient_table(theta)
    smooth, dry = np.zeros((3, n, CELLS, 4)), np.zeros((3 if bristles else 0, n, CELLS, 4))
    waves, rotor, at = [], model.rotors(theta), 0
    for part in model.friction:
        block = coefficients[:, at : at + len(part.coefficients)]
        at += len(part.coefficients)
        if all(c.unit.startswith("kg") for c in part.coefficients) or not np.any(block):
            continue
        if isinstance(part, Periodic):
            waves += _waves(part, block)
            continue
        _check_known(part)
        is_dry = _is_dry(part)
        if np.any(is_dry) and not bristles and getattr(part, "width", 1.0) == 0:
            step = "a sharp sign cannot be integrated; give it a width, such as 0.01 rad/s, or the cell bristles"
            raise BadOption("width", 0.0, step)
        apart = is_dry if bristles else np.zeros_like(is_dry)
        smooth += _cubics(part, np.where(apart, 0.0, block), start)
        if np.any(apart):
            sharp = replace(part, width=SHARP)  # type: ignore[call-arg]
            dry += _cubics(sharp, np.where(apart, block, 0.0), start)
    middle = CELLS // 2
    breakaway = 0.5 * (dry[BASE, :, middle, 0] - _end(dry[BASE, :, middle - 1])) if bristles else np.zeros(n)
    smooth, dry = (table if np.any(table[LOAD:]) else table[:LOAD] for table in (smooth, dry))
    return FrictionTables(smooth, dry, np.array(waves).reshape(-1, 4), rotor, breakaway)


def node_speeds() -> Array:
    """Return the speeds at the four points of every cell, shape (CELLS, 4), in rad/s or m/s; none is exactly 0.

    The ends of cells at standstill lie on the side of the cell, where a jump of the torque belongs to neither.
    """
    left = (np.arange(CELLS) - CELLS // 2)[:, None] * CELL
    speed = FINEST * np.sinh(left + CELL * np.arange(4) / 3.0)
    speed[CELLS // 2, 0], speed[CELLS // 2 - 1, 3] = 1e-12, -1e-12
    return speed


def _cubics(part: Friction, factors: Array, start: Array) -> Array:
    """Return the tables of one part with factors (n, k), shape (3, n, CELLS, 4)."""
    differ = "temperature" in part.needs and bool(np.any(start != start[0]))
    drives = len(factors) if differ else 1  # equal drives have equal columns
    speed = node_speeds().reshape(-1, 1) * np.ones(drives)

    def torque(load: float, degrees: float) -> Array:
        columns = part.columns(_motion(speed, load, start[:drives] + degrees))
        columns = np.broadcast_to(columns, (len(speed), len(factors), factors.shape[1]))
        return np.einsum("sjk,jk->js", columns, factors).reshape(len(factors), CELLS, 4)

    still = torque(0.0, 0.0)
    warm = torque(0.0, 1.0) - still if "temperature" in part.needs else np.zeros_like(still)
    loaded = torque(1.0, 0.0) - still if "torque" in part.needs else np.zeros_like(still)
    return np.stack([still, warm, loaded]) @ _THROUGH.T


def _motion(speed: Array, load: float, temperature: Array) -> Motion:
    nothing = np.zeros_like(speed)
    return Motion(nothing, speed, nothing, nothing + load, nothing + temperature)


#: Values of a cubic at 0, 1/3, 2/3 and 1 to its coefficients of x^0 ... x^3.
_THROUGH = np.linalg.inv(np.vander(np.arange(4) / 3.0, increasing=True))


def _end(cubic: Array) -> Array:
    """Return the value of cubics (..., 4) at the end of their cell."""
    return cubic.sum(axis=-1)


def _is_dry(part: Friction) -> Array:
    """Return which coefficients of a part jump at standstill when its sign is sharp, shape (k,)."""
    none = np.zeros(len(part.coefficients), dtype=bool)
    if "width" not in {field.name for field in fields(part)}:
        return none
    sharp = replace(part, width=SHARP)  # type: ignore[call-arg]
    one = np.array([[1e-9]])
    jump = sharp.columns(_motion(one, 1.0, one + 1e3)) - sharp.columns(_motion(-one, 1.0, one + 1e3))
    return np.abs(jump[0, 0]) > 1e-3


def _check_known(part: Friction) -> None:
    """Refuse a part whose columns depend on position or acceleration, or otherwise on load and temperature."""
    generator = np.random.default_rng(0)
    speed, other, more = generator.uniform(-2.0, 2.0, (3, 40, 1))
    nothing, ones = np.zeros_like(speed), np.ones_like(speed)

    def columns(q: Array, ddq: Array, load: float, temperature: float) -> Array:
        return part.columns(Motion(q, speed, ddq, load * ones, temperature * ones))

    plain = columns(nothing, nothing, 0.0, 20.0)
    per_load = columns(nothing, nothing, 1.0, 20.0) - plain
    per_degree = columns(nothing, nothing, 0.0, 21.0) - plain
    same = [
        (columns(other, more, 0.0, 20.0), plain),
        (columns(nothing, nothing, -3.0, 20.0), plain + 3.0 * per_load),
        (columns(nothing, nothing, 0.0, 50.0), plain + 30.0 * per_degree),
    ]
    if not all(np.allclose(got, want, rtol=1e-9, atol=1e-9) for got, want in same):
        name = FRICTION.name_of(part)
        step = "the cell simulates friction of speed, |load| and temperature, and 'periodic' torque; leave it out"
        raise BadOption("friction", name, step)


def _waves(part: Periodic, block: Array) -> Sequence[tuple[float, float, float, float]]:
    """Return the sines of a periodic part: drive, cycles, factors of sine and cosine."""
    found = []
    for drive, (sine, cosine, sine_two, cosine_two) in enumerate(block):
        for cycles, s, c in ((part.cycles, sine, cosine), (2 * part.cycles, sine_two, cosine_two)):
            if s or c:
                found.append((float(drive), cycles, float(s), float(c)))
    return found
