"""A Python module that needs NumPy only: inverse dynamics, gravity, Coriolis, mass matrix, friction, a self-test."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.subject.drives import drives_of
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import PACE, StateSet, states_of, takes_time
from dynident.exports.models.writing.c_programs import drive_terms, state_updates
from dynident.exports.models.writing.expressions import Dialect
from dynident.exports.names_in_files import module_notes
from dynident.model.chain import PRISMATIC
from dynident.model.friction import FRICTION

_NUMPY: Final = Dialect(
    "{}",
    "np.{}",
    "np.tanh({value} / {width})",
    "np.sign({value})",
    "",
    "",
    "the NumPy module",
    {"pow": "power", "fmax": "maximum", "fmin": "minimum"},
)

#: Inputs of the expressions by the arrays that hold them.
_READINGS: Final = {"x": "at", "v": "speed", "load": "loads", "warm": "temperature"}

#: Samples of the self-test.
REFERENCES = 5


@dataclass(frozen=True)
class Numpy(ModelExporter):
    """Python module that needs NumPy only: inverse dynamics, gravity, Coriolis, mass matrix, friction, a self-test."""

    suffix: ClassVar[str] = ".py"
    proof: ClassVar[str] = "everything by NumPy, as a whole and as the sum of its parts"
    remembers: ClassVar[bool] = True

    def content(self, subject: Identified, path: Path) -> ModelContent:
        model = subject.model
        more = [name for name, signal in (("temperature", "temperature"), ("state", "state")) if signal in model.needs]
        chain = model.robot.chain
        moments = np.array([body.first_moment for body in subject.bodies])
        values: dict[str, Any] = {
            **_memory(subject),
            "JOINTS": model.robot.dof,
            "NAMES": f"({', '.join(ascii(name) for name in model.robot.joint_names)},)",
            "GRAVITY": _text(chain.gravity),
            "PARENT": _text(chain.parent),
            "SLIDES": str([bool(kind == PRISMATIC) for kind in chain.kind]),
            "COLUMN": _text(chain.joint),
            "MULTIPLIER": _text(chain.multiplier),
            "OFFSET": _text(chain.offset),
            "ROTATION": _text(chain.rotation),
            "TRANSLATION": _text(chain.translation),
            "AXIS": _text(chain.axis),
            "MASS": _text(np.array([body.mass for body in subject.bodies])),
            "MOMENT": _text(moments),
            "TENSOR": _text(np.array([body.rotational for body in subject.bodies])),
            "COUPLING": _text(np.asarray(model.robot.coupling)),
            "ARMATURE": _text(drives_of(subject).armature),
            "BIAS": _text(model.robot.bias),
            "MORE": "".join(f", {name}" for name in more),
            "FRICTION": "\n".join(_friction(subject)) or "    # The model has none.",
            "REFERENCE": _reference(subject),
        }
        text = SOURCE
        for name, value in values.items():
            text = text.replace(f"@{name}@", str(value))
        return ModelContent({path: text.encode("ascii")}, (), module_notes(path, "numpy"))

    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: StateSet) -> Iterator[Reloaded]:
        path = folder / next(iter(content.files)).name
        space: dict[str, Any] = {"__name__": "dynident_export"}
        exec(compile(path.read_bytes(), str(path.name), "exec"), space)  # what was just written, names as literals
        motion = states.motion
        more = [] if motion.temperature is None else [motion.temperature]
        step = [] if states.step is None else [states.step]
        more += [] if motion.state is None else [space["states_along"](motion.q, *step)]
        found = space["inverse_dynamics"](motion.q, motion.dq, motion.ddq, *more)
        expected = subject.model.torque(motion, subject.theta)
        yield Reloaded(f"NumPy {np.__version__}", "everything", found, expected)
        few = replace(motion, q=motion.q[:50], dq=motion.dq[:50], ddq=motion.ddq[:50])
        parts = np.einsum("nij,nj->ni", space["mass_matrix"](few.q), few.ddq) + space["gravity"](few.q)
        parts = parts + space["coriolis"](few.q, few.dq)
        parts = parts + space["friction"](few.q, few.dq, few.ddq, *(values[:50] for values in more))
        yield Reloaded(f"NumPy {np.__version__}", "M ddq + Coriolis + gravity + friction", parts, expected[:50])


def _friction(subject: Identified) -> Iterator[str]:
    """Yield the lines that add the friction of each part."""
    model = subject.model
    terms, first = drive_terms(model, subject.theta, _NUMPY), 0
    columns = np.asarray(model.terms[1])
    for part in model.friction:
        drives = list(model.drives_of(part))
        own = [
            [t for t, c in zip(terms, columns, strict=True) if c == first + k] for k in range(len(part.coefficients))
        ]
        first += len(own)
        own = [each for each in own if each and not each[0].is_inertia]
        if not own:
            continue
        yield f"    # {FRICTION.name_of(part)}: {', '.join(each[0].symbol for each in own)}"
        for name, array in _READINGS.items():
            if any(each[0].uses(name) for each in own):
                yield f"    {name} = {array}[:, {drives}]"
        for k in range(sum(len(part.states) for part in model.friction)):
            if any(each[0].uses(f"z{k}") for each in own):
                yield f"    z{k} = state[:, {drives}, {k}]"
        for each in own:
            values = _text(np.array([term.value for term in each]))
            yield f"    torque[:, {drives}] += np.array({values}) * ({each[0].expression})"


def _text(values: Array | IntArray) -> str:
    """Return numbers as Python writes them, to the last bit."""
    return repr((np.asarray(values) + 0).tolist())


def _memory(subject: Identified) -> dict[str, str]:
    """Return what the module has of friction that remembers; all empty where none does."""
    states = state_updates(subject.model, _NUMPY)
    dt = ", dt" if takes_time(subject.model) else ""
    lines = [f"            z{k} = self.state[:, {k}]" for k in range(len(states))]
    lines += [f"            self.state = np.stack([{', '.join(state.expression for state in states)}], axis=1)"]
    values = {
        "MEMORY": MEMORY,
        "MEMORY_ABOUT": f"    Memory().step(q{dt}), states_along(q{dt})  its state, (@JOINTS@, @STATES@) a sample\n",
        "STATE_ROWS": f"    state = np.asarray(state, dtype=float).reshape(-1, len(JOINTS), {len(states)})\n",
        "WALKED": f"    more_.append(states_along(q_{', ' + repr(PACE) if dt else ''}))\n",
    }
    return {name: text if states else "" for name, text in values.items()} | {
        "DT": dt,
        "LATER": " dt s later" if dt else "",
        "STARTS": repr([state.start for state in states]),
        "STATES": str(len(states)),
        "UPDATES": "\n".join(lines),
    }


def _reference(subject: Identified) -> str:
    whole = states_of(subject.model).motion.rows(slice(0, REFERENCES))
    torque = subject.model.torque(whole, subject.theta)
    rows = [whole.q, whole.dq, whole.ddq, *([] if whole.temperature is None else [whole.temperature]), torque]
    return "[\n" + "".join(f"    {_text(np.asarray(row))},\n" for row in rows) + "]"


#: What friction remembers, where it does.
MEMORY: Final = '''class Memory:
    """What friction remembers of the way to a sample: give it positions in the order of time.

    state: of each joint's drive, shape (@JOINTS@, @STATES@), for the argument of that name.
    """

    def __init__(self):
        self.state, self.motor = np.tile(@STARTS@, (len(JOINTS), 1)), None

    def step(self, q@DT@):
        """Move on to the positions (@JOINTS@,) of the next sample@LATER@ and return the state there."""
        motor = COUPLING @ np.asarray(q, dtype=float)
        if self.motor is not None:
            moved = motor - self.motor
@UPDATES@
        self.motor = motor
        return self.state


def states_along(q@DT@):
    """Return the states along positions (N, @JOINTS@) that follow each other@LATER@, (N, @JOINTS@, @STATES@)."""
    memory = Memory()
    return np.array([memory.step(row@DT@) for row in q])


'''

#: Functions of the module; ``@...@`` are replaced.
SOURCE: Final = '''"""Inverse dynamics of an identified robot arm with NumPy alone; written by dynident.

SI units. Positions q, velocities dq and accelerations ddq have the shape (N, @JOINTS@) or (@JOINTS@,), in the order of
JOINTS.

    inverse_dynamics(q, dq, ddq@MORE@)  torque of the drives, with friction: M ddq + c + g + friction
    gravity(q)  torque that holds the arm still, without friction
    coriolis(q, dq)  torque of speed alone, without friction
    mass_matrix(q)  M, rotors included, shape (N, @JOINTS@, @JOINTS@)
    friction(q, dq, ddq@MORE@)  torque of friction and offsets
@MEMORY_ABOUT@
Run the file to check it against the numbers that dynident gave.
"""

import numpy as np

JOINTS = @NAMES@
GRAVITY = np.array(@GRAVITY@)
# One row a link: parent (-1: base), sliding or not, joint that moves it, multiplier and offset, pose, axis.
PARENT = @PARENT@
SLIDES = @SLIDES@
COLUMN = @COLUMN@
MULTIPLIER = @MULTIPLIER@
OFFSET = @OFFSET@
ROTATION = np.array(@ROTATION@)
TRANSLATION = np.array(@TRANSLATION@)
AXIS = np.array(@AXIS@)
# About the origin of the link frame: mass, first moment, tensor.
MASS = @MASS@
MOMENT = np.array(@MOMENT@)
TENSOR = np.array(@TENSOR@)
# Motor speed = COUPLING @ joint speed; rotor inertia at the joint; constant torque that something else gives.
COUPLING = np.array(@COUPLING@)
ARMATURE = np.array(@ARMATURE@)
BIAS = np.array(@BIAS@)


def _rows(*arrays):
    return [np.atleast_2d(np.asarray(array, dtype=float)) for array in arrays]


def _like(result, q):
    return result[0] if np.ndim(q) == 1 else result


def _turns(i, angle):
    """Rotation about the axis of link i (Rodrigues), (N, 3, 3)."""
    x, y, z = AXIS[i]
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)


def _bodies(q, dq, ddq, gravity):
    """Newton and Euler: out along the tree with motion, back with forces."""
    samples = len(q)
    links = len(PARENT)
    turns, shifts, spins, swings, pushes, forces, moments = ([None] * links for _ in range(7))
    for i in range(links):
        position = MULTIPLIER[i] * q[:, COLUMN[i]] + OFFSET[i]
        speed = (MULTIPLIER[i] * dq[:, COLUMN[i]])[:, None] * AXIS[i]
        rise = (MULTIPLIER[i] * ddq[:, COLUMN[i]])[:, None] * AXIS[i]
        p = PARENT[i]
        if p < 0:
            spin0, swing0 = np.zeros((samples, 3)), np.zeros((samples, 3))
            push0 = np.broadcast_to(-gravity, (samples, 3))
        else:
            spin0, swing0, push0 = spins[p], swings[p], pushes[p]
        if SLIDES[i]:
            turn = np.broadcast_to(ROTATION[i], (samples, 3, 3))
            shift = TRANSLATION[i] + position[:, None] * (ROTATION[i] @ AXIS[i])
        else:
            turn = ROTATION[i] @ _turns(i, position)
            shift = np.broadcast_to(TRANSLATION[i], (samples, 3))
        push = push0 + np.cross(swing0, shift) + np.cross(spin0, np.cross(spin0, shift))
        spin, swing, push = (np.einsum("nji,nj->ni", turn, v) for v in (spin0, swing0, push))
        if SLIDES[i]:
            push = push + rise + 2.0 * np.cross(spin, speed)
        else:
            swing = swing + rise + np.cross(spin, speed)
            spin = spin + speed
        turns[i], shifts[i], spins[i], swings[i], pushes[i] = turn, shift, spin, swing, push
        forces[i] = MASS[i] * push + np.cross(swing, MOMENT[i]) + np.cross(spin, np.cross(spin, MOMENT[i]))
        moments[i] = swing @ TENSOR[i] + np.cross(spin, spin @ TENSOR[i]) + np.cross(MOMENT[i], push)
    torque = np.zeros((samples, len(JOINTS)))
    for i in reversed(range(links)):
        along = forces[i] if SLIDES[i] else moments[i]
        torque[:, COLUMN[i]] += MULTIPLIER[i] * (along @ AXIS[i])
        p = PARENT[i]
        if p >= 0:
            force = np.einsum("nij,nj->ni", turns[i], forces[i])
            forces[p] = forces[p] + force
            moments[p] = moments[p] + np.einsum("nij,nj->ni", turns[i], moments[i]) + np.cross(shifts[i], force)
    return torque


def _rotors(ddq):
    return (ddq @ COUPLING.T * ARMATURE) @ COUPLING


def gravity(q):
    (rows,) = _rows(q)
    zero = np.zeros_like(rows)
    return _like(_bodies(rows, zero, zero, GRAVITY), q)


def coriolis(q, dq):
    rows, speeds = _rows(q, dq)
    return _like(_bodies(rows, speeds, np.zeros_like(rows), np.zeros(3)), q)


def mass_matrix(q):
    (rows,) = _rows(q)
    zero = np.zeros_like(rows)
    columns = [_bodies(rows, zero, np.broadcast_to(unit, rows.shape), np.zeros(3)) for unit in np.eye(len(JOINTS))]
    return _like(np.stack(columns, axis=2) + COUPLING.T @ (ARMATURE[:, None] * COUPLING), q)


@MEMORY@def friction(q, dq, ddq@MORE@):
    """Friction and offsets; ddq matters only where friction grows with the load."""
    rows, speeds, rises = _rows(q, dq, ddq)
    loads = np.linalg.solve(COUPLING.T, (_bodies(rows, speeds, rises, GRAVITY) + _rotors(rises)).T).T
@STATE_ROWS@    at, speed, torque = rows @ COUPLING.T, speeds @ COUPLING.T, np.zeros_like(rows)
@FRICTION@
    return _like(torque @ COUPLING - BIAS, q)


def inverse_dynamics(q, dq, ddq@MORE@):
    rows, speeds, rises = _rows(q, dq, ddq)
    moved = _bodies(rows, speeds, rises, GRAVITY) + _rotors(rises)
    return _like(moved + friction(rows, speeds, rises@MORE@), q)


# Positions, velocities, accelerations and the torques that dynident gave for them.
REFERENCE = @REFERENCE@

if __name__ == "__main__":
    q_, dq_, ddq_, *more_, torque_ = (np.array(values) for values in REFERENCE)
@WALKED@    away_ = float(np.abs(inverse_dynamics(q_, dq_, ddq_, *more_) - torque_).max())
    print(f"largest difference of a torque: {away_:.2g}")
    raise SystemExit(0 if away_ < 1e-6 * float(np.abs(torque_).max()) else 1)
'''
