"""The functions of a C header that are unrolled: traced for one robot, its parameters folded in as constants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption, SolverFailed
from dynident.identification.estimate.estimate import Estimate
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.kernels import batched
from dynident.model.kernels.recursion import TracedChain
from dynident.model.kernels.trace import Number, TracedProgram, gradient

#: Operations of all functions together above which no header is written: compilers take minutes for more.
LARGEST = 120_000

#: Largest difference of a torque, relative to the largest, with which base parameters stand for the bodies.
SAME = 1e-10


def folded(model: DynamicModel, theta: Array) -> Array:
    """Return inertial parameters (10 l,) with the same torques and as many zeros as there can be.

    They are the base parameters of the bodies alone, so that the torque of bodies and of drives stay apart. Where axes
    that were meant to be parallel are not quite, the two differ and the parameters stay as they are.
    """
    own = np.asarray(theta, dtype=float)[: model.inertial_count]
    try:
        base = base_parameters(replace(model, friction=()), inertial_only=True)
    except SolverFailed:
        return own
    short = base.to_standard(base.from_standard(own))
    motion, chain = model.random_motion(50, seed=3), model.robot.chain
    full, found = (batched.inverse_dynamics(chain, values, motion.q, motion.dq, motion.ddq) for values in (own, short))
    away, size = np.abs(found - full).max(axis=0), np.abs(full).max(axis=0)
    return short if np.all(away <= SAME * np.maximum(size, 1e-9 * size.max(initial=0.0))) else own


def programs_of(model: DynamicModel, theta: Array, estimate: Estimate | None) -> dict[str, TracedProgram]:
    """Return the traced functions by name.

    ``rigid``: M ddq + c + g with the rotors. ``gravity``, ``coriolis``: parts of it. ``mass_matrix``: M, row-major.
    ``momentum``: M dq, then C' dq = 1/2 d(dq' M dq)/dq. ``bodies``: inertial columns of the regressor, row-major in
    all b columns; only with an estimate.

    Args:
        model: The model.
        theta: Standard parameters, shape (p,).
        estimate: Whose base parameters the regressor has; None for no regressor.

    Raises:
        BadOption: The functions are too long.
    """
    if len(model.robot.links) > 60:
        raise _too_long(f"{len(model.robot.links)} links")
    chain, inertial = model.robot.chain, folded(model, theta)
    floating = replace(chain, gravity=np.zeros(3))
    rotors = rotor_matrix(model, theta)
    size = chain.joints

    rigid = TracedChain(chain, inertial)
    gravity = TracedChain(chain, inertial, {"dq": "", "ddq": ""})
    coriolis = TracedChain(floating, inertial, {"ddq": ""})
    mass = TracedChain(floating, inertial)
    entries = mass.mass()
    for slot, value in enumerate(rotors.ravel().tolist()):
        entries[slot] = entries.get(slot, 0.0) + value
    found = {
        "rigid": rigid.trace.program(_with_rotors(rigid, rigid.torque(), rotors, "ddq")),
        "gravity": gravity.trace.program(gravity.torque()),
        "coriolis": coriolis.trace.program(coriolis.torque()),
        "mass_matrix": mass.trace.program(entries),
        "momentum": _momentum(TracedChain(floating, inertial, {"dq": "", "ddq": "dq"}), rotors),
    }
    if estimate is not None:
        columns = estimate.base.independent
        bodies, count = TracedChain(chain), estimate.base.count
        place = {int(column): k for k, column in enumerate(columns)}
        values = bodies.regressor([int(c) for c in columns if c < model.inertial_count])
        wide = 10 * len(model.robot.links)
        slots = {(slot // wide) * count + place[slot % wide]: value for slot, value in values.items()}
        found["bodies"] = bodies.trace.program(slots)
    total = sum(program.operations for program in found.values())
    if total > LARGEST:
        raise _too_long(f"{total} operations a call of each function")
    assert all(slot < size for slot in found["rigid"].outputs)
    return found


def rotor_matrix(model: DynamicModel, theta: Array) -> Array:
    """Return what rotors, known and identified, add to the mass matrix, shape (n, n)."""
    coupling = np.asarray(model.robot.coupling)
    return model.robot.reflected_inertia + coupling.T @ (model.rotors(theta)[:, None] * coupling)


def _with_rotors(traced: TracedChain, torque: Mapping[int, Number], rotors: Array, array: str) -> dict[int, Number]:
    found = dict(torque)
    for (i, j), value in np.ndenumerate(rotors):
        if value:
            found[i] = found.get(i, 0.0) + float(value) * traced.trace.input(array, j)
    return found


def _momentum(traced: TracedChain, rotors: Array) -> TracedProgram:
    """Return M dq and, behind it, C' dq, which is the slope of the kinetic energy (De Luca and Mattone 2003)."""
    size = len(rotors)
    speeds = {k: traced.trace.input("dq", k) for k in range(size)}
    bodies = traced.torque()
    slopes = gradient(traced.trace, bodies, speeds, [traced.trace.input("q", k) for k in range(size)])
    rates = {size + k: 0.5 * slope for k, slope in enumerate(slopes)}
    return traced.trace.program({**_with_rotors(traced, bodies, rotors, "dq"), **rates})


def _too_long(size: str) -> BadOption:
    step = "the unrolled functions would be too long for a compiler; export to urdf and use a library of dynamics"
    return BadOption("robot", size, step)
