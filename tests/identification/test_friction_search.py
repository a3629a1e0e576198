"""Friction that is chosen and non-linear fields that are found: both from data whose truth is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, Preprocessing, preprocess
from dynident.data.preprocessing.as_given import AsGiven
from dynident.errors import BadOption, LogMismatch
from dynident.identification.files.estimate_file import read_estimate, write_estimate
from dynident.identification.identify import identify
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.selection.friction import column_pool
from dynident.identification.selection.friction.column_pool import PooledLogs
from dynident.identification.selection.friction.nested_fits import entries, fit, nested_fits
from dynident.identification.selection.friction.variable_projection import vary_fields
from dynident.identification.validate import validate
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, auto_friction
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.degressive import Degressive
from dynident.model.friction.load import Load
from dynident.model.friction.periodic import Periodic
from dynident.model.friction.presliding import Presliding
from dynident.model.friction.rotor_inertia import RotorInertia
from dynident.model.friction.stribeck import Stribeck
from dynident.model.friction.viscous import Viscous
from dynident.model.joint import Drive
from dynident.model.robot import Robot
from dynident.results.choices import choice_tables

#: Friction of the three joints of ``mixed``.
TRUTH = np.array([3.0, 2.0, 3.0, 4.0, 0.15, 2.0, 1.5])

GIVEN = Preprocessing(AsGiven(), rest="keep")

MakeLog = Callable[..., Log]


def with_friction(model: DynamicModel, values: Array) -> Array:
    assert model.robot.nominal is not None
    return np.append(model.robot.nominal, values)


@pytest.fixture(scope="module")
def mixed(spatial_3r: Robot) -> DynamicModel:
    parts = (
        Coulomb(0.02),
        Viscous(joints=("joint1", "joint3")),
        Degressive(joints=("joint2",)),
        Load(joints=("joint2",)),
    )
    return DynamicModel(spatial_3r, parts)


@pytest.fixture(scope="module")
def mixed_log(mixed: DynamicModel, exact_log: MakeLog) -> Log:
    return exact_log(mixed, with_friction(mixed, TRUTH), noise=0.3, samples=1600, rate=80.0)


def test_friction_is_chosen_and_the_report_says_what_was_tried(
    mixed: DynamicModel, mixed_log: Log, exact_log: MakeLog, tmp_path: Path
) -> None:
    other_log = exact_log(mixed, with_friction(mixed, TRUTH), noise=0.3, samples=1000, rate=70.0, size=0.8, seed=5)
    bare = DynamicModel(mixed.robot)
    estimate = identify(bare, [mixed_log], "wls", GIVEN, choose_friction=True)
    drafted = identify(replace(bare, friction=auto_friction()), [mixed_log], "wls", GIVEN)
    assert estimate.model.friction == drafted.model.friction
    np.testing.assert_array_equal(estimate.beta, drafted.beta)
    taken = {FRICTION.name_of(part) for part in estimate.model.friction}
    assert {"coulomb", "viscous", "degressive", "load"} <= taken and "stribeck" not in taken
    known = identify(mixed, [mixed_log], "wls", GIVEN)
    default = identify(DynamicModel(mixed.robot, ("coulomb", "viscous", "offset")), [mixed_log], "wls", GIVEN)  # type: ignore[arg-type]
    found, right, wrong = (validate(each, [other_log]).total_relative_error for each in (estimate, known, default))
    assert found < 1.02 * right < 0.95 * wrong
    write_estimate(estimate, tmp_path / "chosen.json")
    read = read_estimate(tmp_path / "chosen.json")
    assert read.model.friction == estimate.model.friction
    np.testing.assert_array_equal(read.beta, estimate.beta)
    (title, table), (_, missing) = choice_tables(read.choices)
    assert title.startswith("Friction model selection")
    left = {row[0]: row[-1] for row in missing.rows}
    tried = {row[0] for row in table.rows} | {*left}
    of_load = {"coulomb, load", "load", "load_directional", "load_stribeck"}
    assert {"rotor_inertia", "degressive", "stribeck", "presliding", "warm_up", "temperature", *of_load} == tried
    assert set(left) == {"warm_up", "temperature"} and "no temperatures are read" in left["temperature"]


@pytest.mark.parametrize("rotor", [0.0, 2.0])
def test_a_rotor_of_a_vertical_slide_is_no_mass(scara: Robot, exact_log: MakeLog, rotor: float) -> None:
    """What held-out samples say nothing of stays, where it would count as mass: with a rotor there and with none."""
    parts = (Coulomb(0.02), Viscous(), FRICTION.make("offset"), RotorInertia())
    truth = DynamicModel(scara, parts)
    names = [parameter.name for parameter in truth.parameters]
    known = {name: 0.0 if name.startswith("Ia") else 0.5 for name in names} | {"Ia[joint3]": rotor}
    theta = with_friction(truth, np.array([known[name] for name in names[truth.inertial_count :]]))
    log = exact_log(truth, theta, noise=0.05, samples=1200, rate=80.0)
    asked = replace(truth, friction=(*parts[:3], RotorInertia(choose=("part",))))
    estimate = identify(asked, [log], "consistent", GIVEN)
    (own,) = (part for part in estimate.model.friction if isinstance(part, RotorInertia))
    assert own.joints == ("joint3",) and not own.is_optional
    (mass,) = (name for name in estimate.base.names if name.startswith("m[link3]"))
    assert "Ia[joint3]" in mass
    known = dict(zip(names, theta.tolist(), strict=True))
    wanted = estimate.base.from_standard(np.array([known.get(each.name, 0.0) for each in estimate.base.parameters]))
    assert np.max(np.abs(estimate.beta - wanted) / estimate.std) < 4.0


@pytest.mark.parametrize(("velocity", "exponent"), [(0.06, 1.0), (0.15, 1.0), (0.06, 2.0), (0.15, 2.0)])
def test_stribeck_friction_is_chosen_where_the_log_has_slow_motion(
    spatial_3r: Robot, exact_log: MakeLog, velocity: float, exponent: float
) -> None:
    """Velocity and exponent are found together, whatever is stated of them; presliding does not stand for either."""
    truth = DynamicModel(spatial_3r, (Coulomb(0.02), Viscous(), Stribeck(velocity, exponent)))
    values = with_friction(truth, np.tile([3.0, 1.0, 2.0], 3))
    log = exact_log(truth, values, noise=0.3, samples=3000, rate=100.0, size=0.5, seed=1)
    chosen = identify(DynamicModel(spatial_3r), [log], "wls", GIVEN, choose_friction=True)
    assert {FRICTION.name_of(part) for part in chosen.model.friction} == {"coulomb", "viscous", "offset", "stribeck"}
    (found,) = (part for part in chosen.model.friction if isinstance(part, Stribeck))
    assert found.velocity == pytest.approx(velocity, rel=0.25) and found.exponent == pytest.approx(exponent, rel=0.25)
    unseen = exact_log(truth, values, samples=1000, rate=100.0, size=0.5, seed=7)
    known = identify(truth, [log], "wls", GIVEN)
    errors = [validate(each, [unseen]).total_relative_error for each in (chosen, known)]
    assert errors[0] < 1.3 * errors[1]


def prepared(model: DynamicModel, values: Array, exact_log: MakeLog, noise: float = 0.05) -> Prepared:
    log = exact_log(model, with_friction(model, values), noise=noise, samples=2000, rate=100.0, size=0.5)
    return preprocess(log, GIVEN)


@pytest.mark.parametrize("velocity", [0.08, 0.4])
def test_a_stribeck_velocity_is_found(planar_2r: Robot, exact_log: MakeLog, velocity: float) -> None:
    model = DynamicModel(planar_2r, (Coulomb(), Viscous(), Stribeck(velocity)))
    log = prepared(model, np.array([3.0, 1.0, 4.0, 2.0, 0.5, 3.0]), exact_log)
    start = replace(model, friction=(*model.friction[:2], Stribeck(0.15, vary=("velocity",))))
    solved, (found,) = vary_fields(start, [log])
    assert found.value == pytest.approx(velocity, rel=0.05)
    assert found.low <= found.value <= found.high
    assert solved.friction[2] == Stribeck(found.value, vary=("velocity",))


def test_two_fields_on_joints_of_their_own(planar_2r: Robot, exact_log: MakeLog) -> None:
    truth = (Coulomb(0.05, joints=("joint1",)), Coulomb(0.15, joints=("joint2",)), Viscous())
    model = DynamicModel(planar_2r, truth)
    log = prepared(model, np.array([3.0, 1.0, 2.0, 0.5]), exact_log)
    guess = tuple(replace(part, width=0.02, vary=("width",)) for part in truth[:2])
    _, found = vary_fields(replace(model, friction=(*guess, Viscous())), [log])
    assert [(each.joints, each.field) for each in found] == [(("joint1",), "width"), (("joint2",), "width")]
    assert [each.value for each in found] == pytest.approx([0.05, 0.15], rel=0.08)


def test_identify_finds_fields_first(planar_2r: Robot, exact_log: MakeLog) -> None:
    model = DynamicModel(planar_2r, (Coulomb(), Viscous(), Degressive(0.3)))
    theta = with_friction(model, np.array([3.0, 1.0, 4.0, 2.0, 0.5, 3.0]))
    log = exact_log(model, theta, noise=0.02, samples=2000, rate=100.0)
    asked = replace(model, friction=(Coulomb(), Viscous(), Degressive(0.6, vary=("exponent",))))
    estimate = identify(asked, [log], "wls", GIVEN)
    (found,) = estimate.choices.non_linear
    assert found.value == pytest.approx(0.3, rel=0.1) and found.part == "degressive"
    part = estimate.model.friction[2]
    assert isinstance(part, Degressive) and part.exponent == found.value
    ((title, table),) = choice_tables(estimate.choices)
    assert title.startswith("Friction fields") and table.rows[0][:3] == ("degressive", "all", "exponent")
    ends = replace(estimate.choices, non_linear=(replace(found, value=found.high),))
    assert not table.note and choice_tables(ends)[0][1].note.endswith("may ask for more: degressive exponent.")


def test_only_non_linear_fields_vary(planar_2r: Robot, exact_log: MakeLog) -> None:
    log = prepared(DynamicModel(planar_2r), np.zeros(0), exact_log)
    with pytest.raises(BadOption, match=r"vary = 'speed' is not possible; the part 'viscous' can vary: nothing"):
        vary_fields(DynamicModel(planar_2r, (Viscous(vary=("speed",)),)), [log])


def test_the_pool_fits_as_least_squares_does(planar_2r: Robot, exact_log: MakeLog) -> None:
    model = DynamicModel(planar_2r, (Coulomb(), Viscous()))
    log = prepared(model, np.array([3.0, 1.0, 2.0, 0.5]), exact_log, noise=0.5)
    pool = PooledLogs(model, [log], blocks=4).pool((Coulomb(), Coulomb(0.1), Viscous()))
    assert [len(each) for each in pool.products] == [4, 4] and pool.rows.sum() == 2 * 2000
    keep = pool.chosen([[0, 2], [0, 2]])
    total = pool.weighted(np.ones(2)).sum(axis=0)
    ols = identify(model, [log.log], "ols", GIVEN)
    square = float(np.sum(ols.train.residual**2))
    losses, mixed = nested_fits(entries(total[None]), entries(total[None]), pool.lists([[[0, 2], [0, 2]]])[None])
    assert losses[0, 0] == pytest.approx(square, rel=1e-6)
    np.testing.assert_allclose(mixed[0, 0, keep], fit(total, keep), rtol=1e-7)


def test_fits_that_take_shared_columns_out_are_those_of_least_squares() -> None:
    """Blocks held out one by one, any columns beside the shared ones, one of which some fits have no rows of."""
    rows = np.random.default_rng(7).normal(size=(3, 40, 8)) * np.geomspace(1e-3, 1e3, 8)
    rows[1:, :, 5] = 0.0
    products = rows.transpose(0, 2, 1) @ rows
    learned = entries(products.sum(axis=0) - products)
    lists = np.zeros((4, 7), dtype=bool)
    for row, keep in zip(lists, ([0, 1, 2], [0, 1, 2, 4], [0, 1, 2, 3, 5, 6], [0, 1, 2, 3]), strict=True):
        row[keep] = True
    for each in (np.stack([lists] * 3), np.stack([lists, lists[::-1], lists])):
        losses, mixed = nested_fits(learned, entries(products), each)
        for b, m in np.ndindex(3, 4):
            seen = np.concatenate([own for k, own in enumerate(rows) if k != b])
            keep = np.flatnonzero(each[b, m])
            beta = np.linalg.lstsq(seen[:, keep], seen[:, -1], rcond=None)[0]
            squares = float(np.sum((rows[b, :, -1] - rows[b][:, keep] @ beta) ** 2))
            assert losses[b, m] == pytest.approx(squares, rel=1e-8)
            expected = np.zeros(8)
            expected[keep], expected[-1] = beta, -1.0
            np.testing.assert_allclose(mixed[b, m], expected, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("kept", [2**28, 0])
def test_pools_of_known_rows_are_those_of_new_ones(
    coupled_arm: Robot, exact_log: MakeLog, monkeypatch: pytest.MonkeyPatch, kept: int
) -> None:
    monkeypatch.setattr(column_pool, "KEPT", kept)
    model = DynamicModel(coupled_arm, (Coulomb(), Viscous()))
    names = coupled_arm.joint_names
    log = prepared(model, np.linspace(0.5, 2.0, 2 * len(names)), exact_log, noise=0.5)
    load = coupled_arm.nominal
    assert load is not None
    lists = [
        (Coulomb(), Load(), Presliding(0.02)),
        (Viscous(), Presliding(0.02), Coulomb(joints=names[1:]), Load(0.1)),
        (Presliding(0.02), Coulomb(choose=("width",)), Coulomb(), Viscous()),
        (),
    ]
    pooled = PooledLogs(model, [log], 4, load, delay_is_free=True)
    for parts in lists:
        again, new = pooled.pool(parts), PooledLogs(model, [log], 4, load, delay_is_free=True).pool(parts)
        products = [pool.weighted(np.ones(len(names))) for pool in (again, new)]
        np.testing.assert_allclose(*products, rtol=1e-12, atol=1e-9)
        np.testing.assert_array_equal(again.chosen([[]] * len(names)), new.chosen([[]] * len(names)))
    whole = DynamicModel(coupled_arm, lists[1])
    base, pool = base_parameters(whole), PooledLogs(model, [log], 1, load).pool(lists[1])
    start = base.from_standard(np.append(load, np.zeros(len(whole.terms[0]))))
    stream, count = RegressorStream(whole, base, start, only="friction"), len(whole.terms[0])
    expected = np.zeros((count, count))
    for columns, rows in zip(stream.columns, stream.rows(log), strict=True):
        own = columns - (base.count - count)
        expected[np.ix_(own, own)] += rows[:-1] @ rows[:-1].T
    found = pool.weighted(np.ones(len(names)))[0][pool.shared : -1, pool.shared : -1]
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-9)


def test_a_stated_cycle_that_the_logs_do_not_show_is_refused(spatial_3r: Robot, exact_log: MakeLog) -> None:
    model = DynamicModel(spatial_3r, (Coulomb(0.02), Viscous()))
    log = exact_log(model, with_friction(model, np.tile([3.0, 1.5], 3)), noise=0.1, samples=400)
    span = np.ptp(log.q, axis=0)[0]
    ripple = Periodic(np.pi / span * 1.02, joints=("joint1",))  # a little more than half a cycle
    assert identify(replace(model, friction=(*model.friction, ripple)), [log], "wls", GIVEN)
    told = rf"periodic repeats after .* rad \(or m\), and less than half of that is seen: 'joint1' {span:.3g};"
    with pytest.raises(LogMismatch, match=told):
        ripple = replace(ripple, cycles=np.pi / span * 0.98)
        identify(replace(model, friction=(*model.friction, ripple)), [log], "wls", GIVEN)
    with pytest.raises(LogMismatch, match="less than half of that is seen: 'joint1' 0;"):  # at rest alone
        ripple = replace(ripple, cycles=5000.0)
        identify(replace(model, friction=(*model.friction, ripple)), [log], "wls", replace(GIVEN, standstill=0.5))


@pytest.mark.parametrize("is_there", [True, False])
def test_ripple_of_motors_is_chosen_where_gear_ratios_are_stated_and_it_is_there(
    spatial_3r: Robot, exact_log: MakeLog, is_there: bool
) -> None:
    """Twice per turn of the motor, as in harmonic drives; joint3 has no gear and none is offered for it."""
    robot = spatial_3r.with_drives({"joint1": Drive(gear_ratio=-50.0), "joint2": Drive(gear_ratio=50.0)})
    truth = DynamicModel(robot, (Coulomb(0.02), Viscous(), Periodic(50.0, joints=("joint1", "joint2"))))
    ripple = {"Ps2[joint1]": 0.5, "Pc2[joint2]": 0.4} if is_there else {}
    usual = {"Fc": 3.0, "Fv": 1.5}
    names = [p.name for p in truth.parameters[truth.inertial_count :]]
    values = np.array([ripple.get(name, usual.get(name[:2], 0.0)) for name in names])
    log = exact_log(truth, with_friction(truth, values), noise=0.1, samples=2000, rate=200.0, size=0.3)
    found = identify(DynamicModel(robot), [log], "wls", GIVEN, choose_friction=True)
    taken = [part for part in found.model.friction if isinstance(part, Periodic)]
    assert [(part.cycles, part.joints) for part in taken] == [(50.0, ("joint1", "joint2"))] * is_there
    told = {p["name"]: p["value"] for p in found.parameters()}
    assert all(told[name] == pytest.approx(value, rel=0.1) for name, value in ripple.items())


def test_no_delay_is_found_where_friction_is_chosen_and_none_is_there(spatial_3r: Robot, exact_log: MakeLog) -> None:
    """Rotors and friction that bends, which a list of the usual three lacks, are no delay."""
    truth = DynamicModel(spatial_3r, (Coulomb(0.02), Degressive(), RotorInertia()))
    values = with_friction(truth, np.tile([3.0, 3.0, 1.0], 3))
    train, test = (exact_log(truth, values, noise=0.05, samples=1500, rate=100.0, seed=seed) for seed in (0, 4))
    chosen = identify(DynamicModel(spatial_3r), [train], "wls", replace(GIVEN, delay_s=None), choose_friction=True)
    known = identify(truth, [train], "wls", GIVEN)
    assert abs(chosen.choices.delays[0].seconds) < 5e-4
    errors = [validate(estimate, [test]).total_relative_error for estimate in (chosen, known)]
    assert errors[0] < 1.02 * errors[1]


def test_rows_of_a_log_serve_it_under_any_delay(spatial_3r: Robot, exact_log: MakeLog) -> None:
    """A delay and its opposite leave out as many rows, at the other end; the torque moves, the rows stay."""
    parts = (Coulomb(), Viscous())
    model = DynamicModel(spatial_3r, parts)
    values = with_friction(model, np.tile([3.0, 1.5], 3))
    log = preprocess(exact_log(model, values, noise=0.1), replace(GIVEN, trim_s=0.0))
    shared = column_pool.SharedRows(spatial_3r, [log])
    later, earlier, again = (shared.under([replace(log, delay_s=d)]) for d in (0.05, -0.05, 0.052))
    assert len(later[0].keep) == len(earlier[0].keep) < len(log.keep)
    assert not np.array_equal(later[0].keep, earlier[0].keep) and np.array_equal(later[0].keep, again[0].keep)
    for logs in (later, earlier):
        pools = [PooledLogs(model, logs, 4, None, True, (1.0, 0.0), rows).pool(parts) for rows in (shared, None)]
        for one, other in zip(*(pool.by_delay(pool.weighted(np.ones(3))) for pool in pools), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())
    assert [rows.shape for rows in shared.friction[parts[0]]] == 3 * [(1, len(log.keep))]
