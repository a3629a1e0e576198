"""Stated values of friction fields that give way to those of held-out samples, and those that stand."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, Preprocessing, preprocess
from dynident.data.preprocessing.as_given import AsGiven
from dynident.errors import BadOption
from dynident.identification.files.estimate_file import summary
from dynident.identification.identify import identify
from dynident.identification.problem.choices import Choices, FieldChoice
from dynident.identification.problem.prior import natural_scale, prior_products
from dynident.identification.selection.friction.held_out_errors import share_of
from dynident.identification.selection.friction.nested_fits import beyond, fit
from dynident.identification.selection.friction.search_friction import search_friction
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Friction, Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.degressive import Degressive
from dynident.model.friction.load import Load
from dynident.model.friction.load_directional import LoadDirectional
from dynident.model.friction.load_stribeck import LoadStribeck
from dynident.model.friction.presliding import Presliding
from dynident.model.friction.rotor_inertia import RotorInertia
from dynident.model.friction.stribeck import Stribeck
from dynident.model.friction.viscous import Viscous
from dynident.model.robot import Robot
from dynident.results.choices import choice_tables
from dynident.results.text import format_number

GIVEN = Preprocessing(AsGiven(), rest="keep")

DRY = Coulomb(0.01, choose=("width",))
FADING = Stribeck(0.1, width=0.01, choose=("part", "width", "velocity"))

MakeLog = Callable[..., Log]


def logged(robot: Robot, parts: tuple[Friction, ...], values: list[float], exact_log: MakeLog, **how: float) -> Log:
    assert robot.nominal is not None
    model = DynamicModel(robot, parts)
    return exact_log(model, np.append(robot.nominal, values), **{"samples": 2000, "rate": 100.0, "size": 0.5} | how)


def rows(*logs: Log) -> list[Prepared]:
    return [preprocess(log, GIVEN) for log in logs]


def choose_fields(*arguments: Any, **options: Any) -> tuple[DynamicModel, tuple[FieldChoice, ...]]:
    search = search_friction(*arguments, **options)
    return search.chosen, search.told


@pytest.mark.parametrize("width", [0.05, 0.2])
def test_a_width_that_the_log_contradicts_gives_way(planar_2r: Robot, exact_log: MakeLog, width: float) -> None:
    log = logged(planar_2r, (Coulomb(width), Viscous()), [3.0, 1.0, 2.0, 0.5], exact_log, noise=0.05)
    asked = DynamicModel(planar_2r, (Coulomb(0.01, choose=("width",)), Viscous()))
    model, (held,) = choose_fields(asked, rows(log))
    assert held.value == held.best == pytest.approx(width, rel=0.06)
    assert model.friction == (Coulomb(held.value, choose=("width",)), Viscous())
    assert held.error is not None and held.gain > 2 * held.error


@pytest.mark.parametrize("seed", range(6))
def test_a_width_that_is_right_stands(planar_2r: Robot, exact_log: MakeLog, seed: int) -> None:
    log = logged(planar_2r, (Coulomb(0.05), Viscous()), [3.0, 1.0, 2.0, 0.5], exact_log, noise=0.3, seed=seed)
    asked = DynamicModel(planar_2r, (Coulomb(0.05, choose=("width",)), Viscous()))
    model, (held,) = choose_fields(asked, rows(log))
    assert model == asked and held.value == held.stated == 0.05


def test_what_only_some_stretches_ask_for_is_not_taken(planar_2r: Robot, exact_log: MakeLog) -> None:
    """Two logs of six have another width: the best of all rows is another one, held-out samples are not sure of it."""
    usual, other = (
        [
            logged(
                planar_2r, (Coulomb(width), Viscous()), [3.0, 1.0, 2.0, 0.5], exact_log, samples=600, noise=0.05, seed=k
            )
            for k in seeds
        ]
        for width, seeds in ((0.02, range(4)), (0.3, (7, 8)))
    )
    asked = DynamicModel(planar_2r, (Coulomb(0.02, choose=("width",)), Viscous()))
    _, (held,) = choose_fields(asked, rows(*usual, *other))
    assert held.value == 0.02 and held.error is not None and 0 < held.gain < 2 * held.error


@pytest.mark.parametrize("fading", [False, True])
def test_drives_that_differ_have_widths_of_their_own(spatial_3r: Robot, exact_log: MakeLog, fading: bool) -> None:
    """The truth is found beside a part that may come: drives with another width have those of both."""
    names, widths = spatial_3r.joint_names, (0.01, 0.01, 0.1)
    dry = tuple(Coulomb(width, joints=(name,)) for name, width in zip(names, widths, strict=True))
    faded = tuple(Stribeck(0.2, width=width, joints=(name,)) for name, width in zip(names, widths, strict=True))
    values = [4.0, 5.0, 3.0, 0.5, 0.8, 0.5, *([3.0, 4.0, 2.0] if fading else [])]
    log = logged(spatial_3r, (*dry, Viscous(), *(faded if fading else ())), values, exact_log, noise=0.03, samples=3000)
    parts = (DRY, Viscous(), replace(FADING, velocity=0.2))
    model, found = choose_fields(DynamicModel(spatial_3r, parts), rows(log))
    kinds = [Coulomb, Coulomb, Viscous, *([Stribeck, Stribeck] if fading else [])]
    assert [type(part) for part in model.friction] == kinds
    for part in model.friction:
        if isinstance(part, Coulomb):
            assert part.joints in (names[:2], names[2:])
            assert part.width == pytest.approx(widths[names.index(part.joints[-1])], rel=0.2)
    (own,) = [held for held in found if held.joints == names[2:]]
    assert (own.field, own.stated) == ("width", 0.01) and own.gain > 0.2


def test_a_slide_has_a_width_of_its_own(sliding_arm: Robot, exact_log: MakeLog) -> None:
    hinges, slides = ("joint1", "joint3"), ("joint2",)
    truth = (Coulomb(0.1, joints=hinges), Coulomb(0.02, joints=slides), Viscous())
    log = logged(sliding_arm, truth, [3.0, 1.0, 20.0, 4.0, 2.0, 0.5], exact_log, noise=0.05)
    model, found = choose_fields(DynamicModel(sliding_arm, (Coulomb(0.02, choose=("width",)), Viscous())), rows(log))
    values = {held.joints: held.value for held in found}
    assert values[slides] == 0.02 and values[hinges] == pytest.approx(0.1, rel=0.06)
    assert [part.joints for part in model.friction] == [hinges, slides, None]


def test_too_few_rows_leave_what_is_stated(planar_2r: Robot, exact_log: MakeLog) -> None:
    log = logged(planar_2r, (Coulomb(0.2), Viscous()), [3.0, 1.0, 2.0, 0.5], exact_log, samples=30)
    _, (held,) = choose_fields(DynamicModel(planar_2r, (Coulomb(0.01, choose=("width",)), Viscous())), rows(log))
    assert (held.value, held.best, held.error) == (0.01, 0.01, None)
    ((title, table),) = choice_tables(Choices(chosen_fields=(held,)))
    assert title == "Friction that was not tried"
    assert table.rows == (("coulomb", "all", "width", "0.01", "too few samples to hold some out"),)


def test_identify_chooses_and_says_so(planar_2r: Robot, exact_log: MakeLog) -> None:
    log = logged(planar_2r, (Coulomb(0.1), Viscous()), [3.0, 1.0, 2.0, 0.5], exact_log, noise=0.05)
    estimate = identify(DynamicModel(planar_2r, (DRY, Viscous())), [log], "wls", GIVEN)
    (held,) = json.loads(json.dumps(summary(estimate)))["extras"]["chosen_fields"]
    part = estimate.model.friction[0]
    assert isinstance(part, Coulomb) and part.width == held["value"] == pytest.approx(0.1, rel=0.06)
    ((title, table),) = choice_tables(estimate.choices)
    assert title.startswith("Friction model selection") and table.rows[0][:4] == ("coulomb", "all", "width", "0.01")
    assert table.rows[0][-1] == "best"


def test_only_a_non_linear_field_can_be_chosen_and_by_one_way(planar_2r: Robot, exact_log: MakeLog) -> None:
    log = logged(planar_2r, (Coulomb(), Viscous()), [3.0, 1.0, 2.0, 0.5], exact_log, samples=300)
    for part, message in (
        (Viscous(choose=("speed",)), r"choose = 'speed' is not possible; the part 'viscous' can choose: part"),
        (Stribeck(choose=("velocity",), vary=("velocity",)), "name a field in vary or in choose, not in both"),
    ):
        with pytest.raises(BadOption, match=message):
            choose_fields(replace(DynamicModel(planar_2r), friction=(part,)), rows(log))


def test_a_part_that_the_log_asks_for_is_taken_and_its_sign_turns_with_the_others(
    planar_2r: Robot, exact_log: MakeLog
) -> None:
    truth = (Coulomb(0.03), Viscous(), Stribeck(0.2, width=0.03))
    log = logged(planar_2r, truth, [3.0, 1.0, 2.0, 2.0, 0.5, 0.7], exact_log, noise=0.05)
    model, found = choose_fields(DynamicModel(planar_2r, (DRY, Viscous(), FADING)), rows(log))
    dry, _, fading = model.friction
    assert isinstance(dry, Coulomb) and isinstance(fading, Stribeck)
    assert dry.width == fading.width == pytest.approx(0.03, rel=0.06) and fading.velocity == pytest.approx(0.2, rel=0.1)
    taken = {(held.part, held.field): held for held in found}
    assert taken["stribeck", "part"].value == 1.0 and ("coulomb, stribeck", "width") in taken
    ((_, table),) = choice_tables(Choices(chosen_fields=found))
    assert ("left out", "there", "in the model") in [(row[3], row[4], row[-1]) for row in table.rows]
    assert {(row[2], row[-1]) for row in table.rows if row[0] == "stribeck" and row[2] != "part"} == {
        ("velocity", "fitted")  # whatever the best of the values that were compared takes off
    }
    assert "'fitted'" in table.note and "best" in {row[-1] for row in table.rows if row[2] == "width"}


def test_a_share_has_its_own_std_and_an_end_of_a_range_is_named(planar_2r: Robot) -> None:
    """Of logarithms the share 1 - e^-x has e^-x times their std; rows of a part stand together."""
    gaps = np.array([3.0, 3.2, 2.8, 3.1, 2.9])
    gain, error = share_of(gaps)
    each = -np.expm1(-(gaps.mean() + 1e-6 * (gaps - gaps.mean())))
    assert gain == pytest.approx(1.0 - np.exp(-3.0)) and error == pytest.approx(1e6 * np.std(each, ddof=1) / 5**0.5)
    found = (
        FieldChoice("presliding", None, "length", 3e-3, 3e-4, 3e-4, 0.1, 0.02),
        FieldChoice("load", None, "part", 0.0, 0.0, 0.0, 0.0, 0.0),
        FieldChoice("presliding", None, "part", 0.0, 1.0, 1.0, gain, error),
    )
    model = DynamicModel(planar_2r, (Coulomb(), Presliding(3e-4)))
    ((_, table), _) = choice_tables(Choices(chosen_fields=found), model)
    assert [row[0] for row in table.rows] == ["presliding", "presliding", "load"]
    assert [row[5] for row in table.rows] == ["10.0 ± 2.0", "95.02 ± 0.35", "–"]
    assert table.note.endswith("At an end of the range that is tried: presliding length.")
    inside, low = replace(found[0], best=5e-3, value=5e-3), replace(found[0], stated=1e-6, not_tried="1e-06 is too low")
    ((_, table), (_, missing)) = choice_tables(Choices(chosen_fields=(inside, low)), model)
    assert "At an end" not in table.note and missing.rows[0][-1] == "1e-06 is too low; the search began at 0.0003"


OPTIONAL = (RotorInertia(choose=("part",)), Degressive(choose=("part",)), Load(0.01, choose=("part", "width")))


@pytest.mark.parametrize(("part", "values"), [(Degressive(), [4.0, 2.0]), (RotorInertia(), [0.3, 0.1])])
def test_of_several_optional_parts_those_of_the_robot_are_taken(
    planar_2r: Robot, exact_log: MakeLog, part: Friction, values: list[float]
) -> None:
    truth = [[3.0, 1.0, values[0]], [2.0, 0.5, values[1]]]
    log = logged(planar_2r, (Coulomb(0.01), Viscous(), part), np.ravel(truth).tolist(), exact_log, noise=0.05)
    model, found = choose_fields(DynamicModel(planar_2r, (Coulomb(0.01), Viscous(), *OPTIONAL)), rows(log))
    taken = {held.part for held in found if held.value == 1.0}
    assert {type(own) for own in model.friction} == {Coulomb, Viscous, type(part)} and len(taken) == 1
    assert all(held.gain > 0.1 for held in found if held.part in taken)
    assert all(held.gain < 0.02 for held in found if held.part not in taken)


@pytest.mark.parametrize("seed", range(4))
def test_no_optional_part_is_taken_where_none_is_there(planar_2r: Robot, exact_log: MakeLog, seed: int) -> None:
    log = logged(planar_2r, (Coulomb(0.01), Viscous()), [3.0, 1.0, 2.0, 0.5], exact_log, noise=0.3, seed=seed)
    model, found = choose_fields(DynamicModel(planar_2r, (Coulomb(0.01), Viscous(), *OPTIONAL)), rows(log))
    assert model.friction == (Coulomb(0.01), Viscous()) and [held.part for held in found] == [
        "rotor_inertia",
        "degressive",
        "load",
    ]


@pytest.mark.parametrize("seed", range(6))
def test_a_part_that_is_not_there_is_left_out(planar_2r: Robot, exact_log: MakeLog, seed: int) -> None:
    """Nor is one whose coefficients would have the sign that physics forbids: dry friction that grows with speed."""
    plain = logged(planar_2r, (Coulomb(0.01), Viscous()), [3.0, 1.0, 2.0, 0.5], exact_log, noise=0.3, seed=seed)
    grown = logged(
        planar_2r, (Coulomb(0.01), Viscous(), Stribeck(0.2, width=0.01)), [3.0, 1.0, -1.0, 2.0, 0.5, -0.4], exact_log,
        noise=0.05, seed=seed,
    )  # fmt: skip
    for log in (plain, grown):
        model, (held,) = choose_fields(DynamicModel(planar_2r, (Coulomb(0.01), Viscous(), FADING)), rows(log))
        assert model.friction == (Coulomb(0.01), Viscous()) and (held.field, held.value) == ("part", 0.0)


#: Load friction as drafts ask for it.
OF_LOAD = (
    Load(0.02, choose=("part",)),
    LoadStribeck(0.1, 0.02, choose=("part", "velocity")),
    LoadDirectional(100.0, 0.02, choose=("part", "velocity")),
)


@pytest.mark.parametrize(
    ("there", "values"),
    [
        ((), ()),
        ((Load(0.02),), (0.1,)),
        ((LoadDirectional(100.0, 0.02),), (0.05, 0.15)),
        ((Load(0.02), LoadStribeck(0.15, 0.02)), (0.05, 0.1)),
        ((Load(0.02), LoadDirectional(0.15, 0.02)), (0.05, 0.05, 0.25)),
    ],
)
def test_load_friction_is_of_the_kind_that_is_there(
    planar_2r: Robot, exact_log: MakeLog, there: tuple[Friction, ...], values: tuple[float, ...]
) -> None:
    """By direction in the place of the plain part, and the share that fades with speed, by direction or not, beside."""
    own = [1.0, 0.5, *values]
    log = logged(planar_2r, (Coulomb(0.02), Viscous(), *there), 2 * own, exact_log, noise=0.05, samples=4000)
    model, told = choose_fields(DynamicModel(planar_2r, (Coulomb(0.02), Viscous(), *OF_LOAD)), rows(log))
    assert [type(part) for part in model.friction[2:]] == [type(part) for part in there]
    tried = {held.part for held in told if held.field == "part" and not held.not_tried}
    assert tried == ({"load"} if not there else {"load", "load_directional", "load_stribeck"})
    if len(there) == 2:
        assert model.friction[-1].options["velocity"] == pytest.approx(0.15, rel=0.2)


def test_load_by_direction_is_not_tried_beside_stated_load(planar_2r: Robot, exact_log: MakeLog) -> None:
    log = logged(planar_2r, (Coulomb(0.02), Viscous(), Load(0.02)), 2 * [1.0, 0.5, 0.1], exact_log, noise=0.05)
    model, told = choose_fields(
        DynamicModel(planar_2r, (Coulomb(0.02), Viscous(), Load(0.02), replace(OF_LOAD[2], choose=("part",)))),
        rows(log),
    )
    assert [type(part) for part in model.friction] == [Coulomb, Viscous, Load]
    assert [(held.part, held.not_tried) for held in told] == [("load_directional", "only where load is chosen")]


@pytest.mark.parametrize("bends", [True, False])
def test_the_table_has_the_fastest_samples_and_what_was_not_tried(
    planar_2r: Robot, exact_log: MakeLog, bends: bool
) -> None:
    """Friction that bends over speed goes on beyond the speeds of a fit, and a fit without it does not."""
    truth = (Coulomb(0.02), Viscous(), *([Degressive()] if bends else []))
    values = [3.0, 1.0, *([4.0] if bends else []), 2.0, 0.5, *([2.0] if bends else [])]
    log = logged(planar_2r, truth, values, exact_log, noise=0.05, samples=3000)
    asked = (replace(DRY, width=0.02), Viscous(), Degressive(choose=("part",)), *OF_LOAD)
    model, found = choose_fields(DynamicModel(planar_2r, asked), rows(log))
    (part,) = [held for held in found if held.part == "degressive"]
    assert (part.fastest or 0.0) > 0.3 if bends else abs(part.fastest or 0.0) < 0.05
    (_, tried), (_, missing) = choice_tables(Choices(chosen_fields=found), model)
    assert len(tried.rows) + len([held for held in found if held.not_tried]) == len(found)
    shown = {(row[0], row[2]): row[-2] for row in tried.rows}
    assert shown["degressive", "part"] == (format_number(100.0 * part.fastest, 2) if part.fastest else "–")
    reasons = {row[0]: row[-1] for row in missing.rows}
    assert reasons["load_stribeck"] == "only where load or load_directional is chosen"
    for name, need in (("temperature", "temperatures"), ("warm_up", "logs of 120 s"), ("periodic", "the cycles")):
        assert str(reasons[name]).startswith(f"not among the parts of the case; it needs {need}")
    assert "viscous" not in reasons and reasons["stribeck"] == "not among the parts of the case"


def test_the_fastest_samples_have_a_say_where_some_are_faster(
    planar_2r: Robot, exact_log: MakeLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = logged(planar_2r, (Coulomb(0.1), Viscous()), [3.0, 1.0, 2.0, 0.5], exact_log, noise=0.05)
    asked = DynamicModel(planar_2r, (DRY, Viscous()))
    _, (held,) = choose_fields(asked, rows(log))
    assert held.fastest is not None and held.fastest > 0.0
    monkeypatch.setattr("dynident.identification.selection.friction.column_pool.FASTEST", 1.0)
    _, (alike,) = choose_fields(asked, rows(log))
    assert alike.fastest is None and alike.value == pytest.approx(held.value, rel=1e-6)


def test_too_few_rows_leave_a_part_out(planar_2r: Robot, exact_log: MakeLog) -> None:
    log = logged(planar_2r, (Coulomb(0.2), Viscous()), [3.0, 1.0, 2.0, 0.5], exact_log, samples=30)
    model, (held,) = choose_fields(DynamicModel(planar_2r, (Coulomb(0.01), Viscous(), FADING)), rows(log))
    assert len(model.friction) == 2 and held.error is None


def test_a_late_torque_is_no_wider_sign(planar_2r: Robot, exact_motion: Callable[..., Motion]) -> None:
    """A delay that nobody took out asks for another width, unless it is free where widths are compared."""
    assert planar_2r.nominal is not None
    model = DynamicModel(planar_2r, (Coulomb(0.02), Viscous()))
    theta, time = np.append(planar_2r.nominal, [3.0, 1.0, 2.0, 0.5]), np.arange(2000) / 100.0
    measured, behind = (exact_motion(2, time - lag, 0.5, seed=3) for lag in (0.0, 0.008))
    torque = model.torque(behind, theta) + 0.02 * np.random.default_rng(0).normal(size=(2000, 2))
    log = Log(planar_2r.joint_names, time, measured.q, measured.dq, measured.ddq, torque=torque)
    asked = replace(model, friction=(Coulomb(0.02, choose=("width",)), Viscous(), FADING))
    for late in (False, True):
        _, found = choose_fields(asked, rows(log), delay_is_free=late)
        width, part = found
        assert (width.field, part.field, part.value) == ("width", "part", 0.0)
        assert (width.value > 0.03 and width.gain > 0.1) if not late else (width.value == 0.02 and width.gain < 0.01)


def test_the_delay_is_found_again_with_the_friction_that_was_chosen(
    planar_2r: Robot, exact_motion: Callable[..., Motion]
) -> None:
    assert planar_2r.nominal is not None
    truth = DynamicModel(planar_2r, (Coulomb(0.05), Viscous(), Stribeck(0.2, width=0.05)))
    theta, time = np.append(planar_2r.nominal, [3.0, 1.0, 2.0, 2.0, 0.5, 0.7]), np.arange(3000) / 100.0
    measured, behind = (exact_motion(2, time - lag, 0.5, seed=3) for lag in (0.0, 0.02))
    torque = truth.torque(behind, theta) + 0.02 * np.random.default_rng(0).normal(size=(3000, 2))
    log = Log(planar_2r.joint_names, time, measured.q, measured.dq, measured.ddq, torque=torque)
    model = DynamicModel(planar_2r, (DRY, Viscous(), FADING))
    estimate = identify(model, [log], "wls", replace(GIVEN, delay_s=None))
    assert estimate.choices.delays is not None
    (delay,) = estimate.choices.delays
    assert delay.applied == pytest.approx(0.02, abs=2e-4)
    assert [type(part) for part in estimate.model.friction] == [Coulomb, Viscous, Stribeck]
    assert estimate.model.friction[0].options["width"] == pytest.approx(0.05, rel=0.1)


def test_what_is_chosen_last_is_chosen_with_the_delay_that_was_found(
    planar_2r: Robot, exact_log: MakeLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = logged(planar_2r, (Coulomb(0.03), Viscous()), [3.0, 1.0, 2.0, 0.5], exact_log, noise=0.05)
    free: list[bool] = []

    def told(*arguments: Any, **options: Any) -> Any:
        free.append(any(value is True for value in (*arguments, *options.values())))
        return search_friction(*arguments, **options)

    monkeypatch.setattr("dynident.identification.selection.friction.search_friction.search_friction", told)
    model = DynamicModel(planar_2r, (DRY, Viscous()))
    estimate = identify(model, [log], "wls", replace(GIVEN, delay_s=None))
    assert free == [True, False]
    monkeypatch.setattr("dynident.identification.build_problem.MOVED", -1.0)  # any delay is another one
    identify(model, [log], "wls", replace(GIVEN, delay_s=None))
    assert free == [True, False, True, False, False]
    again = identify(model, [log], "wls", replace(GIVEN, delay_s=estimate.choices.delay_s))
    assert estimate.choices.chosen_fields is not None and again.choices.chosen_fields is not None
    (found,), (known,) = estimate.choices.chosen_fields, again.choices.chosen_fields
    assert (found.gain, found.value) == pytest.approx((known.gain, known.value), rel=2e-3)
    assert found.value == pytest.approx(0.03, rel=0.01)


@pytest.mark.parametrize("seed", range(10))
def test_a_column_with_no_slow_rows_has_no_say_beyond_them(seed: int) -> None:
    """Against least squares by rows; the difference of products leaves rounding of the column, of either sign."""
    random = np.random.default_rng(seed)
    w = random.normal(size=(400, 5)) * [1.0, 1.0, 1.0, 1e3, 10.0]
    fast = np.arange(400) >= 300
    w[~fast, 3] = 0.0  # the torque is the last column; the first is a body, the others are friction
    products = w.T @ w
    beta = np.linalg.lstsq(w[:, :4], w[:, 4])[0]
    left = w[~fast, 4] - w[~fast, 0] * beta[0]
    beta[1:3], beta[3] = np.linalg.lstsq(w[~fast, 1:3], left)[0], 0.0
    expected = float(np.sum((w[fast, 4] - w[fast, :4] @ beta) ** 2))
    summed = np.sum([np.outer(row, row) for row in w[fast]], axis=0)  # in another order than the whole
    fitted = fit(products, np.arange(4))
    fits, every = np.append(fitted, -1.0)[None], np.ones((1, 4), dtype=bool)
    assert beyond(fits, products, summed, every, 1)[0] == pytest.approx(expected, rel=1e-6)


def test_what_is_compared_holds_the_bodies_within_their_size(spatial_3r: Robot) -> None:
    model = DynamicModel(spatial_3r)
    base, scale = base_parameters(model), natural_scale(model, np.full(3, 10.0), np.ones(3))
    products, factor = prior_products(base, scale), base.matrix * scale.parameters
    centre = np.append(base.from_standard(scale.prior), -1.0)
    assert np.abs(products @ centre).max() < 1e-6 * np.abs(products * centre).max()
    np.testing.assert_allclose(products[:-1, :-1] @ factor @ factor.T, np.eye(base.count), atol=1e-6)
