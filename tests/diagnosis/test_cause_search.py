"""Which causes a search takes in: fits by lstsq, coloured noise by Monte Carlo, causes that hide each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.signal

from dynident.arrays import Array
from dynident.diagnosis.causes.cause_columns import CauseRows
from dynident.diagnosis.causes.cause_search import FITTED, Blame, Cause, CauseSearch
from dynident.diagnosis.causes.noise_spectrum import NoiseSpectrum
from dynident.diagnosis.causes.torque_scales import JointScale
from dynident.diagnosis.causes.trend_findings import believed
from dynident.diagnosis.causes.weighted_fit import weighted_products
from dynident.identification.residuals.covariance import FEWEST_FREE


def search(torques: Array, columns: Array, seed: int = 0) -> CauseSearch:
    """Return a search over two joints that share three columns, white noise besides; columns (k, N, 2) are causes."""
    generator = np.random.default_rng([24, seed])
    count = len(torques)
    blocks = [generator.normal(size=(count, 3)) for _ in range(2)]
    noise = generator.normal(size=(count, 2)) * [1.0, 0.05]
    target = np.stack([block @ [1.0, -2.0, 0.5] for block in blocks], axis=1) + torques + noise
    masks = np.ones(target.shape, bool)
    masks[:7] = False
    places = [np.arange(3)] * 2
    causes = [Cause(f"cause {k}", "", column[None]) for k, column in enumerate(columns)]
    return CauseSearch(CauseRows(blocks, places, 3, target, target, masks), causes)


def test_falls_are_those_of_least_squares() -> None:
    """Of a column that is nearly one of the robot's too, and of two together."""
    generator = np.random.default_rng(1)
    columns = generator.normal(size=(4, 300, 2))
    found = search(0.3 * columns[0], columns)
    near = np.stack([block[:, 0] for block in found.rows.blocks], axis=1)
    found = search(0.3 * columns[0], np.concatenate([columns, near[None] + 1e-3 * columns[:1]]))
    before = found.fit([])
    tried = [(k,) for k in range(5)] + [(0, 4), (1, 3)]
    for causes, fall in zip(tried, found.falls(before, [], tried), strict=True):
        assert fall == pytest.approx(_fall(found, before.variances, causes), rel=3e-3, abs=1e-3), causes


def _fall(found: CauseSearch, variances: Array, causes: tuple[int, ...]) -> float:
    rows, left = found.rows, []
    for chosen in ((), causes):
        extra = [found.causes[k].columns[0] for k in chosen]
        whole, target = [], []
        for i, block in enumerate(rows.blocks):
            mask, weight = rows.masks[:, i], variances[i] ** -0.5
            whole.append(weight * np.column_stack([block, *(column[:, i] for column in extra)])[mask])
            target.append(weight * rows.target[mask, i])
        matrix, aim = np.concatenate(whole), np.concatenate(target)
        left.append(float(np.sum((aim - matrix @ np.linalg.lstsq(matrix, aim, rcond=None)[0]) ** 2)))
    return left[0] - left[1]


def test_causes_in_another_order_are_the_same_fit() -> None:
    columns, order = np.random.default_rng(2).normal(size=(3, 300, 2)), [0, 2, 1]
    found = search(0.3 * columns[0], columns)
    counts, floors = found.rows.counts, found.floors
    start = found.columns.whole / counts + floors
    expected = weighted_products(*found.products(order), found.columns.squares, counts, floors, start)
    np.testing.assert_allclose(found.fit(order).beta, expected.beta, rtol=1e-9)
    np.testing.assert_allclose(found.fit(order).information, expected.information, rtol=1e-9, atol=1e-9)


def test_causes_that_hide_each_other_are_found_and_none_where_there_is_none() -> None:
    """Two nearly equal columns with opposite signs: alone neither takes much off."""
    generator = np.random.default_rng(2)
    common, apart, *others = generator.normal(size=(8, 400, 2)) * [1.0, 0.0]
    columns = np.stack([common + 0.3 * apart, common - 0.3 * apart, *others])
    torque = 0.75 * (columns[0] - columns[1])
    found = search(torque, columns)
    assert found._next(found.fit([]), []) is None
    assert [blame.cause.name for blame in found.blames()] in (["cause 0", "cause 1"], ["cause 1", "cause 0"])
    for seed in range(10):
        assert not search(np.zeros((400, 2)), columns, seed).blames()


def test_an_inertia_below_zero_is_no_cause() -> None:
    """It takes the place of none, alone and beside another that it hides."""
    first, second = np.random.default_rng(5).normal(size=(2, 400, 2)) * [1.0, 0.0]
    for sign in (1.0, -1.0):
        found = search(sign * first, np.stack([first, 0.6 * first + second]))
        found.causes = tuple(replace(cause, is_positive=cause.name == "cause 0") for cause in found.causes)
        names = {blame.cause.name for blame in found.blames()}
        assert ("cause 0" in names) == (sign > 0.0) and names, names
    first, apart = np.random.default_rng(2).normal(size=(2, 400, 2)) * [1.0, 0.0]
    columns = np.stack([first + 0.3 * apart, first - 0.3 * apart])
    found = search(0.75 * (columns[1] - columns[0]), columns)
    assert len(found.blames()) == 2
    found = search(0.75 * (columns[1] - columns[0]), columns)
    found.causes = tuple(replace(cause, is_positive=True) for cause in found.causes)
    assert len(found.blames()) < 2


def test_inertias_below_zero_leave_a_fit_to_the_others() -> None:
    """More of them than are fitted in a round, each of which would take more off than what is there."""
    first, second, *others = np.random.default_rng(7).normal(size=(2 + 2 * FITTED, 400, 2)) * [1.0, 0.0]
    columns = np.stack([first + 0.6 * second, *(-first + 0.1 * other for other in others)])
    found = search(0.5 * first, columns)
    found.causes = tuple(replace(cause, is_positive=cause.name != "cause 0") for cause in found.causes)
    assert [blame.cause.name for blame in found.blames()] == ["cause 0"]


def test_a_cause_gives_way_to_those_that_it_stood_for() -> None:
    """The sum of two columns is taken in first and goes once both are there."""
    first, second, third = np.random.default_rng(3).normal(size=(3, 400, 2)) * [1.0, 0.0]
    columns = np.stack([first + second + 0.4 * third, first, second])
    found = search(0.8 * first + 0.8 * second, columns)
    step = found._next(found.fit([]), [])
    assert step is not None and step[0] == 0
    assert {blame.cause.name for blame in found.blames()} == {"cause 1", "cause 2"}


def test_a_cause_that_explains_as_much_is_told_beside_a_sure_one_though_it_is_not_sure_itself() -> None:
    first, second = np.random.default_rng(3).normal(size=(2, 400, 2)) * [1.0, 0.0]
    torque, near = 0.22 * first, first + 0.35 * second
    (blame,) = search(torque, np.stack([first, near])).blames()
    assert blame.cause.name == "cause 0" and [rival.cause.name for rival in blame.rivals] == ["cause 1"]
    assert not search(torque, near[None] + second).blames()


@pytest.mark.parametrize("pole", [0.9, -0.5])
def test_rows_count_as_the_column_has_them(pole: float) -> None:
    """The variance of a slow and of a fast coefficient under coloured noise, against that of 400 draws."""
    generator = np.random.default_rng(4)
    count = 600
    slow = scipy.signal.lfilter([1.0], [1.0, -0.95], generator.normal(size=count))
    columns = np.stack([slow, np.sign(np.sin(np.arange(count) * 1.1))])[:, :, None]
    columns /= np.sqrt(np.sum(columns**2, axis=1, keepdims=True))
    noise = np.asarray(scipy.signal.lfilter([1.0], [1.0, -pole], generator.normal(size=(400, count + 100))))[:, 100:]
    for column in columns:
        found = noise @ column[:, 0]
        colour = NoiseSpectrum.of_fit([column.T], np.array([float(count)]), 1.0)
        left = [row - value * column[:, 0] for row, value in zip(noise[:40], found[:40], strict=True)]
        power, noisy = colour.sums(
            0, colour.transformed(np.array(left)), colour.transformed(np.repeat(column.T, 40, axis=0)), np.arange(41)
        )
        assert power == pytest.approx(np.sum(column**2))
        told = np.mean(np.maximum(noisy / power, 1.0))
        true = max(1.0, float(np.var(found) / np.var(noise)))
        assert told == pytest.approx(true, rel=0.25), (told, true)


def test_rows_of_fits_counted_together_are_those_of_each_alone() -> None:
    """Against least squares of each fit and complex transforms over the whole circle of frequencies."""
    columns = (
        np.random.default_rng(5).normal(size=(3, 300, 2)) * np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])[:, None]
    )
    found = search(0.5 * columns[0] - 0.5 * columns[1], columns)
    fits = [(0,), (1, 0), (2, 0, 1)]
    for fit, (counts, times) in zip(fits, found.worths(fits), strict=True):
        factors, powers = _factors(found, fit)
        assert counts == pytest.approx(found.rows.counts / factors, rel=1e-6), fit
        assert times == pytest.approx(factors @ powers / powers.sum(), rel=1e-6), fit


def _factors(found: CauseSearch, fit: tuple[int, ...]) -> tuple[Array, Array]:
    """Return the factors of the last column of a fit at each joint, and its power over the variance, shape (n,)."""
    rows, plain, after = found.rows, found.fit([]), found.fit(fit)
    count, joints = rows.target.shape
    extra = [found.causes[k].columns[0] for k in fit]
    wholes = [np.column_stack([block, *(column[:, i] for column in extra)]) for i, block in enumerate(rows.blocks)]
    wholes = [np.where(rows.masks[:, i, None], whole, 0.0) for i, whole in enumerate(wholes)]
    stacked = np.concatenate([w / np.sqrt(v) for w, v in zip(wholes, after.variances, strict=True)])
    mix = np.append(-np.linalg.lstsq(stacked[:, :-1], stacked[:, -1], rcond=None)[0], 1.0)
    first = np.concatenate([w[:, :3] / np.sqrt(v) for w, v in zip(wholes, plain.variances, strict=True)])
    hat = np.linalg.qr(first)[0].reshape(joints, count, 3)
    factors, powers, size = np.ones(joints), np.zeros(joints), 2 * (found.spectrum.left.shape[1] - 1)
    half = found.spectrum.half
    near = np.abs((np.arange(size) + size // 2) % size - size // 2) <= half
    for i, whole in enumerate(wholes):
        residual = np.where(rows.masks[:, i], rows.target[:, i], 0.0) - whole @ after.beta
        taken = (np.abs(np.fft.fft(hat[i], size, axis=0)) ** 2).sum(axis=1) / rows.counts[i]
        averaged = [
            np.fft.ifft(np.fft.fft(values) * np.fft.fft(near)).real / (2 * half + 1)
            for values in (np.abs(np.fft.fft(residual, size)) ** 2, taken)
        ]
        noise, power = (
            averaged[0] / np.maximum(1.0 - averaged[1], FEWEST_FREE),
            np.abs(np.fft.fft(whole @ mix, size)) ** 2,
        )
        factors[i] = max(1.0, float(np.mean(noise * power) / max(np.mean(noise) * np.mean(power), 1e-300)))
        powers[i] = power.sum() / after.variances[i]
    return factors, powers


def test_the_size_of_a_scale_is_that_of_its_likeliest_figure() -> None:
    """The column of a scale is a straight line: it says 46 % where the profile says 1 / 0.95."""
    cause = Cause("torque scale", "wrist", np.ones((1, 4, 1)))
    zeros = np.zeros(1)
    blame = Blame(cause, np.array([0.46]), np.eye(1), 20.0, 1.0, 0.62, 0.46, zeros, zeros)
    told = believed(blame, lambda joint: JointScale(joint, 0.95, 0.92, 0.99, 0.03))
    assert told is not None
    assert told.size == pytest.approx(1 / 0.95 - 1) == told.values[0]


@pytest.mark.parametrize(("value", "is_told"), [(-0.55, True), (1.2, True), (-1.0, False), (1.6, False)])
def test_a_scale_of_all_torques_is_told_up_to_where_the_check_of_their_unit_tells_it(
    value: float, is_told: bool
) -> None:
    """A scale of none, beside which errors of the bodies are all of them, explains the torques as well."""
    zeros = np.zeros(1)
    blame = Blame(
        Cause("torque scale", "", np.ones((1, 4, 1))), np.array([value]), np.eye(1), 9.0, 1.0, 0.0, 0.5, zeros, zeros
    )
    assert (believed(blame) is not None) == is_told


@pytest.mark.parametrize(
    ("name", "compliance", "deviation", "load", "is_told"),
    [
        ("joint elasticity", 1e-3, 1e-4, 20.0, True),
        ("joint elasticity", 1e-2, 1e-3, 20.0, False),  # 0.2 rad under the torque of the log: friction, and no gear
        ("spring", 2.0, 0.5, 0.0, True),
        ("spring", 0.01, 0.009, 0.0, False),
        ("counterbalance", 0.04, 0.1, 0.0, False),
    ],
)
def test_a_figure_that_is_absurd_or_may_be_none_is_not_told(
    name: str, compliance: float, deviation: float, load: float, is_told: bool
) -> None:
    """On rigid arms with sharp friction notes had told gears of 0.02 N m/rad, and springs of 0.01 +- 0.02 N m/rad."""
    values, covariance, each = np.array([compliance]), np.array([[deviation**2]]), np.ones(1)
    cause = Cause(name, "joint_1", np.ones((1, 4, 1)), is_positive=name == "joint elasticity", load=load)
    assert (believed(Blame(cause, values, covariance, 8.0, 20.0, 0.5, 0.1, each, each)) is not None) == is_told
