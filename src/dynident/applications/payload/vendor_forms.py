"""A payload in the words of robot controllers: their commands, units and axes.

All three take the centre of mass from the flange. Universal Robots: kg, m, kg m^2, moments about the centre of mass in
the axes of the flange, order Ixx Iyy Izz Ixy Ixz Iyz, with the products as elements of the matrix. KUKA: kg, mm,
degrees A B C about Z, then Y, then X to the principal axes, and the principal moments. ABB: kg, mm, a quaternion to
the principal axes, and the principal moments; the load of a gripper is stated in the frame of the tool.
"""

from __future__ import annotations

import numpy as np

from dynident.applications.payload.carried_load import CarriedLoad
from dynident.applications.payload.statement import mass_doubt
from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.model.inertia import Inertia


def unplaced_reason(load: CarriedLoad) -> str:
    """Return why the mass is none that a load has or that the log tells; else what to do for a better log."""
    if doubt := load.contradiction or mass_doubt(load.mass):
        return doubt
    mass = ", or state --mass" if not load.mass.known else ""
    centre = "; where no axis does, as along the axes of a SCARA, enter a measured centre of mass in the controller"
    return f"record larger and faster motions that turn the payload against gravity{mass}{centre}"


def vendor_forms(load: CarriedLoad) -> dict[str, str]:
    """Return the payload as a command or declaration by vendor.

    Inertia stands in it only where the log determines all of it; else it is that of a point, and the caller has to say
    so.

    Raises:
        BadOption: Mass or centre of mass are not determined.
    """
    if not load.placed:
        raise BadOption("payload", f"{', '.join(load.unknown)} not determined well enough", unplaced_reason(load))
    return forms_of(load.body, load.inertia_known)


def forms_of(body: Inertia, with_inertia: bool = True) -> dict[str, str]:
    """Return a body in the frame of the flange as a command or declaration by vendor; without inertia as a point."""
    moments, axes = principal_axes(body.about_centre) if with_inertia else (np.zeros(3), np.eye(3))
    x, y, z = body.centre_of_mass
    cog = f"[{x:.6g}, {y:.6g}, {z:.6g}]"
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = body.about_centre
    universal = f"set_payload({body.mass:.6g}, {cog})"
    if with_inertia:
        six = ", ".join(f"{value:.6g}" for value in (xx, yy, zz, xy, xz, yz))
        universal = f"set_target_payload({body.mass:.6g}, {cog}, [{six}])"
    a, b, c = np.round(np.degrees(angles_zyx(axes)), 4) + 0.0
    mm = ", ".join(f"{name} {round(1e3 * value, 4) + 0.0:.4f}" for name, value in zip("XYZ", (x, y, z), strict=True))
    turn = f"A {a:.4f}, B {b:.4f}, C {c:.4f}"
    own = ", ".join(f"{name} {value:.6g}" for name, value in zip("XYZ", moments, strict=True))
    turned = ", ".join(f"{value:.8f}" for value in quaternion(axes))
    place = ", ".join(f"{round(1e3 * value, 4) + 0.0:.4f}" for value in (x, y, z))
    principal = ", ".join(f"{value:.6g}" for value in moments)
    return {
        "universal_robots": universal,
        "kuka": f"LOAD_DATA[1] = {{M {body.mass:.6g}, CM {{{mm}, {turn}}}, J {{{own}}}}}",
        "abb": f"PERS loaddata load1 := [{body.mass:.6g}, [{place}], [{turned}], {principal}];",
    }


def principal_axes(inertia: Array) -> tuple[Array, Array]:
    """Return the principal moments (3,) and a rotation (3, 3) with inertia = R diag(moments) R', nearest to no turn."""
    moments, axes = np.linalg.eigh(inertia)
    order = np.zeros(3, dtype=np.int64)
    left = [0, 1, 2]
    for row in range(3):  # each axis takes the principal axis that points most along it
        order[row] = max(left, key=lambda k: abs(axes[row, k]))
        left.remove(int(order[row]))
    axes, moments = axes[:, order], moments[order]
    axes = axes * np.where(np.diag(axes) < 0, -1.0, 1.0)
    if np.linalg.det(axes) < 0:
        axes[:, 2] = -axes[:, 2]
    return moments, axes


def angles_zyx(rotation: Array) -> Array:
    """Return the angles about z, then y, then x of R = Rz(a) Ry(b) Rx(c), shape (3,), in rad."""
    b = float(np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0])))
    if np.hypot(rotation[0, 0], rotation[1, 0]) < 1e-12:  # b = +-90 degrees: a and c turn about one axis
        return np.array([np.arctan2(-rotation[0, 1], rotation[1, 1]), b, 0.0])
    a = np.arctan2(rotation[1, 0], rotation[0, 0])
    return np.array([a, b, np.arctan2(rotation[2, 1], rotation[2, 2])])


def quaternion(rotation: Array) -> Array:
    """Return the unit quaternion (w, x, y, z) of a rotation with w >= 0, shape (4,)."""
    xx, yy, zz = np.diag(rotation)
    squares = 0.25 * np.array([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz])
    first = int(np.argmax(squares))
    r = rotation
    products = 0.25 * np.array(
        [
            [0.0, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], 0.0, r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], 0.0, r[1, 2] + r[2, 1]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 0.0],
        ]
    )
    size = float(np.sqrt(squares[first]))
    found = products[first] / size
    found[first] = size
    return found if found[0] >= 0 else -found
