"""Torques by Pinocchio, from the file as Pinocchio reads it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dynident.arrays import Array
from dynident.results.model_exporters.subject.states import States


def version() -> str:
    """Return the name with its version; empty where it is not installed."""
    try:
        import pinocchio  # pyright: ignore[reportMissingImports]
    except ImportError:
        return ""
    return f"Pinocchio {getattr(pinocchio, '__version__', '')}".strip()


def torque(
    path: Path, kind: Literal["urdf", "mjcf"], states: States, settings: Mapping[str, Any] | None = None
) -> Array:
    """Return the torques of a file on the states, shape (N, n), in N m or N.

    ``rnea`` has the armature; damping and friction, which the parser loads but ``rnea`` passes over, are added from the
    loaded model with the sharp sign.

    Args:
        path: The file.
        kind: Its format.
        states: The states; those of all joints of the file follow from them.
        settings: ``armature``, ``damping`` and ``friction`` by joint name that are set first, as a user of a pair does.
    """
    import pinocchio as pin  # pyright: ignore[reportMissingImports]

    api: Any = pin
    model = api.buildModelFromUrdf(str(path)) if kind == "urdf" else api.buildModelFromMJCF(str(path))
    model.gravity.linear = np.asarray(states.gravity)  # a URDF has none, and that of an MJCF is passed over
    joints = list(model.names)[1:]
    place = [int(model.joints[i + 1].idx_v) for i in range(len(joints))]
    for what, values in (settings or {}).items():
        vector = getattr(model, what).copy()
        for name, value in values.items():
            vector[place[joints.index(name)]] = value
        setattr(model, what, vector)
    q, dq, ddq = states.of(joints)
    found = np.empty_like(q)
    data = model.createData()
    spots = [(int(m.idx_q), int(m.nq)) for m in list(model.joints)[1:]]
    velocity, acceleration = np.zeros(model.nv), np.zeros(model.nv)
    position = np.zeros(model.nq)
    for k in range(len(q)):
        for j, (start, width) in enumerate(spots):
            position[start : start + width] = (np.cos(q[k, j]), np.sin(q[k, j])) if width == 2 else q[k, j]
        velocity[place], acceleration[place] = dq[k], ddq[k]
        found[k] = api.rnea(model, data, position, velocity, acceleration)[place]
    friction = dq * np.asarray(model.damping)[place] + np.sign(dq) * np.asarray(model.friction)[place]
    return states.gather(joints, found + friction)
