"""Torques by Pinocchio, MuJoCo and Drake, each where it is installed, from a file as the engine reads it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dynident.arrays import Array
from dynident.exports.models.subject.states import StateSet
from dynident.exports.models.writing.xml_edit import without_elements


def pinocchio_version() -> str:
    """Return the name with its version; empty where it is not installed."""
    try:
        import pinocchio  # pyright: ignore[reportMissingImports]
    except ImportError:
        return ""
    return f"Pinocchio {getattr(pinocchio, '__version__', '')}".strip()


def pinocchio_torque(
    path: Path, kind: Literal["urdf", "mjcf"], states: StateSet, settings: Mapping[str, Any] | None = None
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


def mujoco_version() -> str:
    """Return the name with its version; empty where it is not installed."""
    try:
        import mujoco
    except ImportError:
        return ""
    return f"MuJoCo {mujoco.__version__}"


@contextmanager
def without_log() -> Iterator[None]:
    """Have MuJoCo write no file of warnings into the folder where the command runs; the proof judges the model."""
    import mujoco

    api: Any = mujoco
    before = api.get_mju_user_warning()
    api.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        api.set_mju_user_warning(before)


def mujoco_torque(path: Path, kind: Literal["urdf", "mjcf"], states: StateSet, *, bodies_only: bool = False) -> Array:
    """Return the torques of a URDF or MJCF on the states, shape (N, n), in N m or N.

    ``mj_inverse`` has armature and damping of joints and tendons. Dry friction is a constraint of its solver: it is
    added from the loaded model with the sharp sign, the other constraints are off. Shapes of a URDF are left out, so
    that no mesh is looked for, and gravity is set, which a URDF has none of. ``bodies_only`` leaves out what is not
    read of an MJCF: springs, tendons, gravity compensation, a fluid.
    """
    import mujoco

    api: Any = mujoco
    data = path.read_bytes()
    is_urdf = kind == "urdf"
    if is_urdf:
        data = without_elements(data, ("visual", "collision"))
        stripped = path.with_name(f"stripped-{path.name}")
        stripped.write_bytes(data)
        path = stripped
    with without_log():
        return _torque_of(api, api.MjModel.from_xml_path(str(path)), states, is_urdf, bodies_only)


def _torque_of(api: Any, model: Any, states: StateSet, is_urdf: bool, bodies_only: bool) -> Array:
    if is_urdf:
        model.opt.gravity = states.gravity
    model.opt.disableflags |= int(api.mjtDisableBit.mjDSBL_CONSTRAINT)
    moving = [i for i in range(model.njnt) if model.jnt_type[i] >= int(api.mjtJoint.mjJNT_SLIDE)]  # none floats
    joints = [model.joint(i).name or f"joint{i + 1}" for i in moving]
    places, dofs = model.jnt_qposadr[moving], model.jnt_dofadr[moving]
    q, dq, ddq = states.of(joints)
    state, found = api.MjData(model), np.empty_like(q)
    if bodies_only:
        _without_forces(api, model, state)
    for k in range(len(q)):
        state.qpos[places], state.qvel[dofs], state.qacc[dofs] = q[k], dq[k], ddq[k]
        api.mj_inverse(model, state)
        found[k] = state.qfrc_inverse[dofs]
    found += np.sign(dq) * model.dof_frictionloss[dofs]
    for tendon in np.flatnonzero(model.tendon_frictionloss):  # those of springs have none
        part = slice(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
        row = np.zeros(model.njnt)
        row[model.wrap_objid[part]] = model.wrap_prm[part]
        row = row[moving]
        found += np.sign(dq @ row)[:, None] * row * model.tendon_frictionloss[tendon]
    return states.gather(joints, found)


def _without_forces(api: Any, model: Any, state: Any) -> None:
    """Take springs, tendons, gravity compensation and fluid out of a model of MuJoCo."""
    model.opt.disableflags |= int(api.mjtDisableBit.mjDSBL_SPRING)
    model.body_gravcomp[:] = 0.0
    model.opt.density = model.opt.viscosity = 0.0
    for name in ("tendon_stiffness", "tendon_damping", "tendon_armature", "tendon_frictionloss", "dof_dampingpoly"):
        if hasattr(model, name):
            getattr(model, name)[:] = 0.0
    api.mj_setConst(model, state)


def drake_version() -> str:
    """Return the name with its version; empty where it is not installed."""
    if find_spec("pydrake") is None:
        return ""
    try:
        return f"Drake {metadata.version('drake')}"
    except metadata.PackageNotFoundError:  # built from its sources
        return "Drake"


def drake_torque(source: Path | str, states: StateSet, base: str, package: str = "") -> Array:
    """Return the torques of an SDF or of a file of model directives on the states, shape (N, n), in N m or N.

    Inverse dynamics has reflected inertia and, from the force elements, damping. Drake has no Coulomb friction.

    Args:
        source: The text of an SDF, or the file of directives.
        states: The states.
        base: Name of the base link, which is welded to the world unless directives do it, or ``world``.
        package: Name of the package that directives speak of; it is the folder of the file.
    """
    from pydrake.multibody.parsing import LoadModelDirectives, Parser, ProcessModelDirectives  # pyright: ignore[reportMissingImports]
    from pydrake.multibody.plant import MultibodyPlant  # pyright: ignore[reportMissingImports]
    from pydrake.multibody.tree import ModelInstanceIndex, MultibodyForces  # pyright: ignore[reportMissingImports]

    plant: Any = MultibodyPlant(0.0)
    parser: Any = Parser(plant)

    def named(part: Any) -> str:
        """Return a name with those of the nested models that it is in."""
        return "::".join([*plant.GetModelInstanceName(part.model_instance()).split("::")[1:], part.name()])

    def model_of(part: Any) -> str:
        return plant.GetModelInstanceName(part.model_instance()).split("::")[0]

    def one_way() -> list[Any]:
        return [joint for joint in map(plant.get_joint, plant.GetJointIndices()) if joint.num_velocities() == 1]

    if isinstance(source, Path):
        parser.package_map().Add(package, str(source.parent))
        ProcessModelDirectives(LoadModelDirectives(str(source)), plant, parser=parser)
    else:
        parser.AddModelsFromString(source, "sdf")
        if base != "world":
            instances = map(ModelInstanceIndex, range(plant.num_model_instances()))
            bodies = (plant.get_body(index) for one in instances for index in plant.GetBodyIndices(one))
            robots = {model_of(joint) for joint in one_way()}  # other models are objects beside it
            carrier = next(body for body in bodies if named(body) == base and model_of(body) in robots)
            plant.WeldFrames(plant.world_frame(), carrier.body_frame())
    plant.mutable_gravity_field().set_gravity_vector(np.asarray(states.gravity))
    plant.Finalize()
    joints = one_way()
    order = [named(joint) for joint in joints]
    at, rates = ([getattr(joint, f"{what}_start")() for joint in joints] for what in ("position", "velocity"))
    q, dq, ddq = states.of(order)
    context, found = plant.CreateDefaultContext(), np.empty_like(q)
    place, speed, rate = plant.GetPositions(context), *np.zeros((2, plant.num_velocities()))  # objects beside it rest
    for k in range(len(q)):
        place[at], speed[rates], rate[rates] = q[k], dq[k], ddq[k]
        plant.SetPositions(context, place)
        plant.SetVelocities(context, speed)
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        found[k] = plant.CalcInverseDynamics(context, rate, forces)[rates]
    return states.gather(order, found)
