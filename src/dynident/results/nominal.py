"""The robot model's own parameters beside the identified ones: torque errors, and the bodies link by link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.identification.consistency.labels import IDENTIFIED, NOT_DETERMINED, ONLY_COMBINED, labels_of
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation
from dynident.model.inertia import Inertia
from dynident.results.text import MISSING, Table, columns_of, format_number, format_percent, label

#: Signs of what a parameter of an estimate stands on, and what they mean.
SIGNS = {IDENTIFIED: "●", ONLY_COMBINED: "◐", NOT_DETERMINED: "○"}
MEANINGS = ", ".join(f"{sign} {word}" for word, sign in SIGNS.items())

#: Parameters of a link, the mass the last of them.
_PER_LINK = 10

#: What is said where nothing can be compared.
NO_INERTIAS = "the robot model states no inertias for every link: no nominal parameters to compare with"
NO_BODIES = "base parameters only: no masses to compare with those of the robot model"


@dataclass(frozen=True)
class LinkChange:
    """The body of a link in the robot model and in an estimate.

    Attributes:
        link: Its name.
        mass: In kg, nominal and identified.
        centre: Centre of mass in the link's frame, in m, three numbers each.
        inertia: About the centre of mass in axes of the link's frame: xx, yy, zz, xy, xz, yz in kg m^2.
        mass_is: What the mass of the estimate stands on, a word of
            :mod:`dynident.identification.consistency.labels`.
    """

    link: str
    mass: tuple[float, float]
    centre: tuple[tuple[float, ...], tuple[float, ...]]
    inertia: tuple[tuple[float, ...], tuple[float, ...]]
    mass_is: str

    @property
    def mass_change(self) -> float:
        """Identified less nominal mass over the nominal one, a fraction; NaN for a nominal mass of zero."""
        before, after = self.mass
        return after / before - 1 if before else float("nan")

    @property
    def centre_shift(self) -> float:
        """How far the centre of mass lies from the nominal one, in m."""
        return float(np.linalg.norm(np.subtract(*self.centre)))

    @property
    def inertia_change(self) -> float:
        """Change of the trace of the inertia about the centre of mass, a fraction; NaN for a nominal one of zero."""
        before, after = (sum(values[:3]) for values in self.inertia)
        return after / before - 1 if before else float("nan")

    def figures(self) -> dict[str, Any]:
        """Return the bodies and their change as plain data; a number that does not exist is None."""
        changes = {key: getattr(self, key) for key in ("mass_change", "centre_shift", "inertia_change")}
        pairs = {
            "mass": {"nominal": self.mass[0], "identified": self.mass[1], "is": self.mass_is},
            "centre": {"nominal": list(self.centre[0]), "identified": list(self.centre[1])},
            "inertia": {"nominal": list(self.inertia[0]), "identified": list(self.inertia[1])},
        }
        return {"link": self.link, **pairs, **{key: v if np.isfinite(v) else None for key, v in changes.items()}}


def link_changes(estimate: Estimate) -> tuple[LinkChange, ...]:
    """Return the links side by side; empty where the robot model or the estimate has no bodies."""
    robot = estimate.model.robot
    if robot.nominal is None or estimate.theta is None:
        return ()
    end = _PER_LINK * len(robot.links)
    before, after = (np.asarray(theta)[:end].reshape(-1, _PER_LINK) for theta in (robot.nominal, estimate.theta))
    words = [each.word for each in labels_of(estimate)[_PER_LINK - 1 : end : _PER_LINK]]
    each = zip(robot.links, before, after, words, strict=True)
    return tuple(_change(link.name, nominal, found, word) for link, nominal, found, word in each)


def _change(name: str, nominal: np.ndarray, identified: np.ndarray, mass_is: str) -> LinkChange:
    bodies = [Inertia.from_vector(row) for row in (nominal, identified)]
    about = [np.asarray(body.about_centre) if body.mass > 0 else np.zeros((3, 3)) for body in bodies]
    centres = [body.centre_of_mass if body.mass > 0 else np.zeros(3) for body in bodies]
    first, second = (tuple(map(float, (a[0, 0], a[1, 1], a[2, 2], a[0, 1], a[0, 2], a[1, 2]))) for a in about)
    here, there = (tuple(map(float, centre)) for centre in centres)
    return LinkChange(name, (bodies[0].mass, bodies[1].mass), (here, there), (first, second), mass_is)


def links_table(changes: tuple[LinkChange, ...]) -> Table:
    """Return mass, shift of the centre of mass and change of the inertia of each link, narrow enough for a terminal."""
    columns = columns_of(
        "link", ">nominal mass [kg]", ">estimate [kg]", "mass is", ">centre moved [mm]", ">inertia [%]"
    )
    rows = tuple(
        (
            label(each.link),
            *(format_number(mass, 3) for mass in each.mass),
            SIGNS[each.mass_is],
            format_number(1e3 * each.centre_shift, 3),
            _signed(each.inertia_change),
        )
        for each in changes
    )
    return Table(columns, rows, f"mass is {MEANINGS}; inertia: change of the trace about the centre of mass")


def bodies_table(changes: tuple[LinkChange, ...]) -> Table:
    """Return the bodies of the links in full, two rows a link: nominal, then estimate."""
    axes = ("xx", "yy", "zz", "xy", "xz", "yz")
    columns = columns_of(
        "link",
        "parameters",
        ">mass [kg]",
        *(f">centre {axis} [m]" for axis in "xyz"),
        *(f">I{pair} [kg·m²]" for pair in axes),
    )
    rows = [
        (
            label(each.link) if k == 0 else "",
            word,
            *(_figure(value) for value in (each.mass[k], *each.centre[k], *each.inertia[k])),
        )
        for each in changes
        for k, word in enumerate(("nominal", "estimate"))
    ]
    return Table(columns, tuple(rows))


def errors_table(validation: Validation) -> Table:
    """Return the relative torque errors of the nominal and the identified parameters, per joint and in total."""
    nominal = validation.nominal
    if nominal is None:
        return Table((), ())
    columns = columns_of("joint", ">nominal [%]", ">nominal, friction fitted [%]", ">identified [%]")
    each = zip(validation.joints, nominal.joints_nothing_fitted, nominal.joints_friction_fitted, strict=True)
    rows = [(label(fit.name), *map(_share, (bare, friction, fit.relative_error))) for fit, bare, friction in each]
    total = (nominal.nothing_fitted, nominal.friction_fitted, validation.total_relative_error)
    return Table(columns, (*rows, ("total", *map(_share, total))))


def missing_reason(estimate: Estimate) -> str:
    """Return why links cannot be set side by side; empty where they can."""
    if estimate.model.robot.nominal is None:
        return NO_INERTIAS
    return NO_BODIES if estimate.theta is None else ""


def _share(value: float) -> str:
    return format_percent(value, sign=False)


def _signed(value: float) -> str:
    text = format_percent(value, sign=False)
    return f"+{text}" if value > 0 and text != MISSING and text[0].isdigit() else text


def _figure(value: float) -> str:
    return "0" if abs(value) < 1e-9 else format_number(value, 3)
