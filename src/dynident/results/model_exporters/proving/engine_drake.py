"""Torques by Drake, where it is installed, from the file as Drake reads it."""

from __future__ import annotations

from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.results.model_exporters.subject.states import States


def version() -> str:
    """Return the name with its version; empty where it is not installed."""
    if find_spec("pydrake") is None:
        return ""
    try:
        return f"Drake {metadata.version('drake')}"
    except metadata.PackageNotFoundError:  # built from its sources
        return "Drake"


def torque(path: Path, states: States, base: str, package: str = "") -> Array:
    """Return the torques of an SDF or of a file of model directives on the states, shape (N, n), in N m or N.

    Inverse dynamics has reflected inertia and, from the force elements, damping. Drake has no dry friction of joints.

    Args:
        path: The file.
        states: The states.
        base: Name of the base link, which is welded to the world unless directives do it.
        package: Name of the package that directives speak of; it is the folder of the file.
    """
    from pydrake.multibody.parsing import (  # pyright: ignore[reportMissingImports]
        LoadModelDirectives,
        Parser,
        ProcessModelDirectives,
    )
    from pydrake.multibody.plant import MultibodyPlant  # pyright: ignore[reportMissingImports]
    from pydrake.multibody.tree import MultibodyForces  # pyright: ignore[reportMissingImports]

    plant: Any = MultibodyPlant(0.0)
    parser: Any = Parser(plant)
    if package:
        parser.package_map().Add(package, str(path.parent))
        ProcessModelDirectives(LoadModelDirectives(str(path)), plant, parser=parser)
    else:
        parser.AddModelsFromString(path.read_text(encoding="utf-8"), "sdf")  # whatever the file is called
        plant.WeldFrames(plant.world_frame(), plant.GetBodyByName(base).body_frame())
    plant.mutable_gravity_field().set_gravity_vector(np.asarray(states.gravity))
    plant.Finalize()
    moving = [joint for joint in map(plant.get_joint, plant.GetJointIndices()) if joint.num_velocities() == 1]
    joints = [joint.name() for joint in moving]
    places = [int(joint.velocity_start()) for joint in moving]
    q, dq, ddq = (values[:, np.argsort(places)] for values in states.of(joints))
    order = [joints[k] for k in np.argsort(places)]
    context, found = plant.CreateDefaultContext(), np.empty_like(q)
    for k in range(len(q)):
        plant.SetPositions(context, q[k])
        plant.SetVelocities(context, dq[k])
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        found[k] = plant.CalcInverseDynamics(context, ddq[k], forces)
    return states.gather(order, found)
