"""The texts of URDF elements that carry a model: numbers to the last bit, the tensor about the centre in link axes."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dynident.arrays import Array
from dynident.model.inertia import Inertia


def number(value: float) -> str:
    """Return a number so that reading it gives the same bits; zero has no sign."""
    return repr(float(value) + 0.0)


def numbers(values: Iterable[float] | Array) -> str:
    """Return numbers with blanks between."""
    return " ".join(number(value) for value in values)


def inertia_tags(body: Inertia) -> tuple[str, str, str]:
    """Return the elements origin, mass and inertia of a body: ``rpy="0 0 0"``, so that every reader agrees."""
    tensor = body.about_centre
    names = (("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1), ("iyz", 1, 2), ("izz", 2, 2))
    entries = " ".join(f'{name}="{number(tensor[i, j])}"' for name, i, j in names)
    return (
        f'<origin xyz="{numbers(np.asarray(body.centre_of_mass))}" rpy="0 0 0"/>',
        f'<mass value="{number(body.mass)}"/>',
        f"<inertia {entries}/>",
    )
