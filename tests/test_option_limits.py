"""Numbers that a case file states for a part: none ends in a traceback or runs without end."""

from __future__ import annotations

import numpy as np
import pytest

from dynident.data.preprocessing import FILTERS
from dynident.errors import BadOption, SolverFailed
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.simulated.course import smoothed
from dynident.model.friction import FRICTION
from dynident.plugins import Family
from dynident.simulation.controllers import CONTROLLERS

#: Options whose size costs nothing.
FREE = {"seed"}

COUNTS = [
    (family, name, option.name)
    for family in (FILTERS, ESTIMATORS, FRICTION, CONTROLLERS)
    for name in family.names()
    for option in family.options(name)
    if option.kind.startswith("int") and option.name not in FREE
]


@pytest.mark.parametrize(("family", "name", "option"), COUNTS)
def test_a_count_has_a_limit(family: Family[object], name: str, option: str) -> None:
    with pytest.raises(BadOption, match=rf"{option} = 1000000000 is not possible; give .*\d"):
        family.make_from_text(name, {option: "1000000000"})


@pytest.mark.parametrize(
    ("family", "name", "option", "values"),
    [
        (FILTERS, "smoothing_spline", "position_noise", ("1e300", "1e-300")),
        (FILTERS, "kalman_smoother", "position_noise", ("1e300", "1e-300")),
        *((ESTIMATORS, name, "reference_hz", ("1e300", "1e-300")) for name in ("iv", "cloe", "clie", "didim")),
        *((ESTIMATORS, name, "bandwidth_hz", ("1e300", "1e-300")) for name in ("iv", "cloe", "clie", "didim")),
        *((ESTIMATORS, name, "control_hz", ("1e300", "1e-300")) for name in ("iv", "cloe", "clie", "didim")),
        *((FRICTION, name, "width", ("1e300", "1e-300")) for name in ("coulomb", "degressive", "stribeck", "load")),
        (ESTIMATORS, "kalman", "spread", ("1e300", "1e-300")),
        (ESTIMATORS, "kalman", "slopes_hz", ("1e300", "1e-300")),
    ],
)
def test_a_number_that_arithmetic_cannot_follow(
    family: Family[object], name: str, option: str, values: tuple[str, str]
) -> None:
    for value, word in zip(values, ("less", "more"), strict=True):
        with pytest.raises(BadOption, match=rf"{option} = .* is not possible; give [\de+.-]+ or {word}$"):
            family.make_from_text(name, {option: value})


def test_limits_hold_from_end_to_end_and_nothing_within() -> None:
    option = {one.name: one for one in FILTERS.options("five_point")}["repeats"]
    assert FILTERS.make("five_point", {"repeats": option.most}) == FILTERS.make_from_text(
        "five_point", {"repeats": "1000"}
    )
    with pytest.raises(BadOption, match="repeats = 1001 is not possible; give 1000 or less"):
        FILTERS.make("five_point", {"repeats": 1001})
    with pytest.raises(BadOption, match="repeats = 0 is not possible; give 1 or more"):  # the part's own rule
        FILTERS.make("five_point", {"repeats": 0})
    assert ESTIMATORS.make("ml", {"order": None}) == ESTIMATORS.make("ml")


def test_a_cut_off_that_is_lost_to_rounding() -> None:
    with pytest.raises(
        SolverFailed, match="the zero-phase filter found no solution: its cut-off is one period in 100000"
    ):
        smoothed(np.random.default_rng(0).normal(size=(3000, 1)), 1e-5)
