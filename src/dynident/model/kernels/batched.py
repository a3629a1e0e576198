"""The dynamics of a chain over many samples: the calls that the rest of the package uses.

Shapes: N samples, n joints, l links; q in rad or m, dq and ddq its derivatives, theta (10 l,) in SI units about the
link frames. Every call accepts N = 0.

Each call runs a kernel that is generated for the robot on its first use (about a tenth of a second, kept for the
process), or, for robots too large for that, the generic kernel that numba compiles once per installation. They agree to
1e-10 of the largest entry. The environment variable DYNIDENT_KERNEL forces one of them: ``generic``, ``generated``;
``auto`` is the default. Nothing is compiled, and no compiler is imported, before the first call. NaN in a sample stays
in that sample; so do joint angles beyond 2^31 rad, whose sine the generated kernels give as NaN.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.model.kernels.generated import chain_kernel, evaluated_once
from dynident.model.kernels.inputs import parameters, samples
from dynident.model.kernels.joint_columns import JointColumns
from dynident.model.robot import Chain

__all__ = ["JointColumns", "inverse_dynamics", "link_poses", "mass_matrix", "torque_regressor"]


def torque_regressor(
    chain: Chain, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike, once: bool = False
) -> Array:
    """Return Y with tau = Y theta.

    Args:
        chain: The robot.
        q: Positions, shape (N, n).
        dq: Velocities, shape (N, n).
        ddq: Accelerations, shape (N, n).
        once: For a few samples of a robot that will not be asked for again: NumPy, and nothing is compiled.

    Returns:
        Shape (N, n, 10 l), the columns of each link in the order of :data:`dynident.model.inertia.TEN`.

    Raises:
        ValueError: A shape is wrong.
    """
    q, dq, ddq = samples(chain, {"q": q, "dq": dq, "ddq": ddq})
    found = evaluated_once(chain, "regressor", {"q": q, "dq": dq, "ddq": ddq}) if once else None
    if found is not None:
        return found.reshape(len(q), chain.joints, 10 * chain.links)
    kernel = chain_kernel(chain, "regressor")
    if kernel is None:
        return _generic_regressor(chain, q, dq, ddq)
    out = np.empty((len(q), chain.joints, 10 * chain.links))
    kernel.run((q, dq, ddq), (out,), len(q))
    return out


def _generic_regressor(chain: Chain, q: Array, dq: Array, ddq: Array) -> Array:
    from dynident.model.kernels import generic_batches  # numba loads with the first call
    from dynident.model.kernels.generic import pack

    links, tables = chain.links, pack(chain)
    out = np.empty((len(q), links * 10 * links))
    generic_batches.regressor(*tables, q, dq, ddq, out)
    rows = out.reshape(len(q), links, 10 * links)
    if np.array_equal(chain.joint, np.arange(chain.joints)):
        return rows
    summed = np.zeros((len(q), chain.joints, 10 * links))
    for link, joint in enumerate(chain.joint):
        summed[:, joint] += rows[:, link]
    return summed


def inverse_dynamics(
    chain: Chain, theta: npt.ArrayLike, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
) -> Array:
    """Return the joint torques tau = M ddq + c + g, shape (N, n), in N m or N.

    Args:
        chain: The robot.
        theta: Inertial parameters, shape (10 l,); physical or not.
        q: Positions, shape (N, n).
        dq: Velocities, shape (N, n).
        ddq: Accelerations, shape (N, n).

    Raises:
        ValueError: A shape is wrong.
    """
    q, dq, ddq = samples(chain, {"q": q, "dq": dq, "ddq": ddq})
    theta = parameters(chain, theta)
    out = np.empty((len(q), chain.joints))
    kernel = chain_kernel(chain, "torque")
    if kernel is not None:
        kernel.run((theta, q, dq, ddq), (out,), len(q))
        return out
    from dynident.model.kernels import generic_batches
    from dynident.model.kernels.generic import pack

    tables = pack(chain)
    generic_batches.inverse_dynamics(*tables, theta, q, dq, ddq, out)
    return out


def mass_matrix(chain: Chain, theta: npt.ArrayLike, q: npt.ArrayLike, once: bool = False) -> Array:
    """Return the joint-space mass matrices M(q), shape (N, n, n), symmetric.

    Args:
        chain: The robot.
        theta: Inertial parameters, shape (10 l,); physical or not.
        q: Positions, shape (N, n).
        once: For a few samples of a robot that will not be asked for again: NumPy, and nothing is compiled.

    Raises:
        ValueError: A shape is wrong.
    """
    (q,) = samples(chain, {"q": q})
    theta = parameters(chain, theta)
    found = evaluated_once(chain, "mass", {"theta": theta, "q": q}) if once else None
    if found is not None:
        return found.reshape(len(q), chain.joints, chain.joints)
    out = np.empty((len(q), chain.joints, chain.joints))
    kernel = chain_kernel(chain, "mass")
    if kernel is not None:
        kernel.run((theta, q), (out,), len(q))
        return out
    from dynident.model.kernels import generic_batches
    from dynident.model.kernels.generic import pack

    links, reals, _ = pack(chain)
    generic_batches.mass_matrix(links, reals, theta, q, out)
    return out


def link_poses(chain: Chain, q: npt.ArrayLike) -> tuple[Array, Array]:
    """Return the poses of the link frames in the base frame.

    Args:
        chain: The robot.
        q: Positions, shape (N, n).

    Returns:
        Rotations (N, l, 3, 3) and translations (N, l, 3) in m.

    Raises:
        ValueError: A shape is wrong.
    """
    (q,) = samples(chain, {"q": q})
    out = np.empty((len(q), chain.links, 12))
    kernel = chain_kernel(chain, "frames")
    if kernel is not None:
        kernel.run((q,), (out,), len(q))
    else:
        from dynident.model.kernels import generic_batches
        from dynident.model.kernels.generic import pack

        links, reals, _ = pack(chain)
        generic_batches.link_poses(links, reals, q, out)
    return out[:, :, :9].reshape(len(q), chain.links, 3, 3), out[:, :, 9:].copy()
