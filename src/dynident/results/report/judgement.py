"""The few rules of thumb by which a report speaks plainly; each is said where it is used."""

from __future__ import annotations

import numpy as np

#: A base parameter is well known when its standard deviation is at most this share of its value.
WELL_KNOWN = 0.10

#: Total relative error up to which a fit is called so.
GRADES = ((0.05, "very good"), (0.10, "good"), (0.20, "usable"))

#: A test error above this many training errors deserves a word.
GAP = 1.5


def grade(relative_error: float) -> str:
    """Return a word for a total relative error; ``not known`` for NaN."""
    if np.isnan(relative_error):
        return "not known"
    return next((word for limit, word in GRADES if relative_error <= limit), "poor")


def tone(relative_error: float) -> str:
    """Return ``good``, ``fair`` or ``bad`` for a total relative error."""
    return {"very good": "good", "good": "good", "usable": "fair"}.get(grade(relative_error), "bad")
