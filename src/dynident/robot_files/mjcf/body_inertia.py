"""The inertia of a body: its <inertial>, or what its geoms give it, within the bounds of the compiler."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynident.arrays import Array
from dynident.model.documents.numbers import shown
from dynident.model.inertia import Inertia
from dynident.robot_files.mjcf.document import CompilerSettings
from dynident.robot_files.mjcf.poses import ORIENTATIONS, pose_of
from dynident.robot_files.xml_elements import Element, Values

#: Mass, centre of mass, inertia about it.
Body = tuple[float, Array, Array]


def stated_body(element: Element, compiler: CompilerSettings) -> Body:
    """Return mass, centre of mass and inertia about it of an ``<inertial>``, in the axes of its body.

    Raises:
        DescriptionError: A missing or negative value, both kinds of inertia, or fullinertia with an orientation.
    """
    values = Values(element.place, element.attributes)
    values.text("pos")
    mass = values.at_least_zero("mass")
    rotation, centre = pose_of(values, compiler)
    if "fullinertia" in values:
        if "diaginertia" in values or any(name in values for name in ORIENTATIONS):
            step = "keep fullinertia alone, or diaginertia with the orientation"
            raise values.place.error("fullinertia stands beside diaginertia or an orientation", step)
        xx, yy, zz, xy, xz, yz = values.numbers("fullinertia", 6)
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    elif "diaginertia" in values:
        diagonal = values.numbers("diaginertia", 3)
        if np.any(diagonal < 0.0):
            text = shown(values.text("diaginertia"))
            raise values.place.error(f"diaginertia {text} is negative", "write 0 or more")
        tensor = rotation @ np.diag(diagonal) @ rotation.T
    else:
        tensor = np.zeros((3, 3))
    return mass, centre, tensor


def inertia_of_body(
    stated: Body | None, geoms: Sequence[Inertia], compiler: CompilerSettings, place: Array
) -> Inertia | None:
    """Return the inertia that counts, about the origin of the body; None where nothing states one.

    Args:
        stated: What its ``<inertial>`` states.
        geoms: The inertia of its geoms.
        compiler: Settings of the compiler.
        place: Position of the body as written, shape (3,), in m: where MuJoCo has the centre of mass of a body that
            nothing but a bound gives a mass.
    """
    found = stated
    if geoms and (compiler.from_geoms == "true" or (compiler.from_geoms == "auto" and stated is None)):
        whole = geoms[0]
        for more in geoms[1:]:
            whole = whole + more
        found = whole.mass, np.asarray(whole.centre_of_mass), np.asarray(whole.about_centre)
    if found is None and max(compiler.least_mass, compiler.least_inertia) > 0.0:
        found = 0.0, place, np.zeros((3, 3))
    if found is None:
        return None
    mass, centre, tensor = found
    if compiler.least_mass > 0.0 or compiler.least_inertia > 0.0 or compiler.balances:
        mass = max(mass, compiler.least_mass)
        moments, axes = np.linalg.eigh(tensor)
        moments = np.maximum(moments, compiler.least_inertia)
        if compiler.balances and moments[0] + moments[1] < moments[2]:
            moments = np.full(3, moments.mean())
        tensor = (axes * moments) @ axes.T
    return Inertia.from_centre_of_mass(mass, centre, tensor)
