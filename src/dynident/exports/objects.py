"""An identified model as a value of Pinocchio or MuJoCo, without a file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from dynident.diagnosis.verdict import causes_against
from dynident.errors import MissingDependency, NotAccepted
from dynident.exports.models import MODEL_EXPORTERS
from dynident.exports.models.subject.identified import identified
from dynident.identification.estimate.estimate import Estimate


def pinocchio_model(estimate: Estimate, *, force: bool = False) -> Any:
    """Return an identified model as ``pinocchio.Model``: inertias, armature, damping, Coulomb friction, gravity.

    ``rnea`` has bodies and armature; it passes over damping and friction, which stand in the model. Joints that follow
    another are free in it, and continuous joints have cosine and sine as position.

    Args:
        estimate: The estimate.
        force: Take one that findings of the log checks at error level speak against.

    Raises:
        MissingDependency: Pinocchio is not installed.
        NotAccepted: Findings of the log checks at error level speak against the estimate.
        NotConsistent: No physically consistent robot has the base parameters of the estimate.
    """
    try:
        import pinocchio  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise MissingDependency("a model of Pinocchio", "pin", "pin") from error
    pin: Any = pinocchio
    urdf, settings = _files(estimate, "pinocchio", force)[:2]
    model = pin.buildModelFromXML(urdf.decode("utf-8"))
    facts = json.loads(settings)
    model.gravity.linear = np.array(facts["gravity"])
    for what in ("armature", "damping", "friction"):
        values = getattr(model, what).copy()
        for name, value in facts[what].items():
            values[model.joints[model.getJointId(name)].idx_v] = value
        setattr(model, what, values)
    return model


def mujoco_spec(estimate: Estimate, *, force: bool = False) -> Any:
    """Return an identified model as ``mujoco.MjSpec``, to be attached to a scene or compiled.

    Args:
        estimate: The estimate.
        force: Take one that findings of the log checks at error level speak against.

    Raises:
        MissingDependency: MuJoCo is not installed.
        NotAccepted: Findings of the log checks at error level speak against the estimate.
        NotConsistent: No physically consistent robot has the base parameters of the estimate.
    """
    try:
        import mujoco
    except ImportError as error:
        raise MissingDependency("a model of MuJoCo", "mujoco", "mujoco") from error
    engine: Any = mujoco
    return engine.MjSpec.from_string(_files(estimate, "mjcf", force)[0].decode("utf-8"))


def _files(estimate: Estimate, exporter: str, force: bool) -> list[bytes]:
    """Return the files of an exporter, written anew and not to disk."""
    for cause in () if force else causes_against(estimate):
        step = "correct it and identify again, or give force=True"
        raise NotAccepted("the estimate is not accepted", str(cause), step)
    content = MODEL_EXPORTERS.make(exporter).content(identified(estimate), Path("identified"))
    return list(content.files.values())
