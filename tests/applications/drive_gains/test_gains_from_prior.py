"""Gains against known bodies, and what doubt about gains does to base parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from loaded_arms import GIVEN, LoadedArm

from dynident.applications.drive_gains import GainOptions, gains_from_prior
from dynident.data.log import torque_from_current
from dynident.diagnosis.warnings import warnings_of
from dynident.errors import BadOption
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators.wls import WLS
from dynident.identification.fit import fit
from dynident.identification.uncertainty.propagation import gain_slopes, gain_uncertainty
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive
from dynident.model.robot import Link, Robot

GAINS = np.array([14.0, -9.0, 6.0])


@pytest.mark.parametrize("method", ["structured", "wls"])
def test_exact_bodies_give_exact_gains(spatial_3r: Robot, method: str) -> None:
    arm = LoadedArm(spatial_3r, GAINS, ("coulomb", "viscous", "offset", "rotor_inertia"))
    gains = gains_from_prior(arm.model, [arm.log(False)], preprocessing=GIVEN, options=GainOptions(method=method))
    np.testing.assert_allclose([gain.value for gain in gains.gains], GAINS, rtol=1e-6)
    assert gains.scale == "known bodies, taken to be exact"


def test_bodies_that_are_a_tenth_too_heavy_make_gains_a_tenth_too_large(spatial_3r: Robot) -> None:
    arm = LoadedArm(spatial_3r, GAINS)
    assert spatial_3r.nominal is not None
    gains = gains_from_prior(arm.model, [arm.log(False)], 1.1 * spatial_3r.nominal, preprocessing=GIVEN)
    np.testing.assert_allclose([gain.value for gain in gains.gains], 1.1 * GAINS, rtol=1e-6)


def test_a_share_takes_wrong_bodies_into_the_intervals(spatial_3r: Robot) -> None:
    arm = LoadedArm(spatial_3r, GAINS)
    assert spatial_3r.nominal is not None
    generator, inside, narrow = np.random.default_rng(3), [], []
    for seed in range(16):
        theta = np.concatenate([another(link, 0.05, generator) for link in spatial_3r.links])
        log = arm.log(False, 0.05, seed)
        for share, held in ((0.05, inside), (0.0, narrow)):
            gains = gains_from_prior(arm.model, [log], theta, share, GIVEN)
            held.append([gain.low <= true <= gain.high for gain, true in zip(gains.gains, GAINS, strict=True)])
    assert 0.85 <= np.mean(inside) <= 1.0
    assert np.mean(narrow) < 0.8  # what taking them for exact costs


def test_bodies_that_are_far_from_the_stated_ones_do_not_shrink_the_gains(spatial_3r: Robot) -> None:
    arm, generator = LoadedArm(spatial_3r, GAINS), np.random.default_rng(5)
    for seed in range(4):
        theta = np.concatenate([another(link, 0.3, generator) for link in spatial_3r.links])
        found = gains_from_prior(arm.model, [arm.log(False, 0.05, seed)], theta, 0.05, GIVEN)
        ratios = np.array([gain.value for gain in found.gains]) / GAINS
        assert 0.5 < ratios.min() and ratios.max() < 2.0, ratios


def test_a_share_that_leaves_no_verdict_is_told_with_one_that_gives_it(spatial_3r: Robot) -> None:
    log = (arm := LoadedArm(spatial_3r, GAINS)).log(False, 0.05)
    loose = gains_from_prior(arm.model, [log], share=0.3, preprocessing=GIVEN)
    (told,) = loose.remarks
    named = told.partition("(")[2].partition(")")[0].split(", ")
    enough = float(told.partition("--prior-share ")[2].split()[0])
    assert not loose.complete and named and 0.02 < enough < 0.3
    better = gains_from_prior(arm.model, [log], share=enough, preprocessing=GIVEN)
    assert set(named) <= set(better.by_joint()) and better.remarks == ()


@pytest.mark.parametrize("lean", [-15.0, 100.0, 180.0])
def test_a_base_that_stands_otherwise_contradicts_known_bodies(spatial_3r: Robot, lean: float) -> None:
    arm = LoadedArm(spatial_3r, GAINS, ("coulomb", "viscous", "load"))
    tilt = np.radians(lean)
    stated = 9.81 * np.array([0.0, np.sin(tilt), -np.cos(tilt)])
    wrong = replace(arm.model, robot=spatial_3r.with_gravity(stated))
    for share in (0.0, 0.05):
        gains = gains_from_prior(wrong, [arm.log(False, 0.02)], share=share, preprocessing=GIVEN)
        assert all("the stated gravity contradicts the logs" in gain.reason for gain in gains.gains)
        angle = float(gains.gains[0].reason.partition(" degrees off")[0].rpartition(" ")[2])
        assert angle == pytest.approx(abs(lean), abs=0.7)
        assert gains_from_prior(arm.model, [arm.log(False, 0.02)], share=share, preprocessing=GIVEN).complete
    floating = replace(arm.model, robot=spatial_3r.with_gravity(np.zeros(3)))  # no direction to be found
    assert "gravity" not in gains_from_prior(floating, [arm.log(False)], preprocessing=GIVEN).gains[0].reason


@pytest.mark.parametrize(
    ("factor", "order", "words"),
    [
        ([1.0, -1.0, 1.0], [0, 1, 2], "with the position of joint2 reversed"),
        ([1.0, 1.0, 1.0], [0, 2, 1], "with the currents of joint2 and joint3 exchanged"),
        ([180.0 / np.pi] * 3, [0, 1, 2], "with positions in deg that were read as radians"),
    ],
    ids=["sign", "order", "unit"],
)
def test_columns_that_are_read_wrongly_are_named(
    spatial_3r: Robot, factor: list[float], order: list[int], words: str
) -> None:
    """A gain follows whatever motion its current is put beside: gains came out wrong, with narrow intervals."""
    arm = LoadedArm(spatial_3r, GAINS)
    log = arm.log(False, 0.02)
    assert log.dq is not None and log.ddq is not None and log.current is not None
    motion = {name: getattr(log, name) * np.array(factor) for name in ("q", "dq", "ddq")}
    gains = gains_from_prior(
        arm.model, [replace(log, **motion, current=log.current[:, order])], share=0.1, preprocessing=GIVEN
    )
    assert gains.by_joint() == {} and all(words in gain.reason for gain in gains.gains), gains.gains[0].reason


def another(link: Link, share: float, generator: np.random.Generator) -> np.ndarray:
    """Return the ten parameters of a link whose mass, centre and inertia are off by a share."""
    body = link.inertia
    assert body is not None
    factor, *steps = 1.0 + share * generator.normal(size=5)
    size = np.sqrt(np.sum(np.asarray(body.vector)[[0, 3, 5]]) / 2.0 / body.mass)
    centre = body.centre_of_mass + size * (np.array(steps[:3]) - 1.0)
    inertia = factor * abs(steps[3]) * body.about_centre
    return np.asarray(Inertia.from_centre_of_mass(factor * body.mass, centre, inertia).vector)


def test_a_drive_that_the_bodies_hardly_ask_for_is_named(spatial_3r: Robot) -> None:
    arm = LoadedArm(spatial_3r, GAINS)
    light = replace(
        spatial_3r.links[2], inertia=Inertia.from_vector(1e-4 * np.asarray(spatial_3r.links[2].inertia.vector))
    )  # type: ignore[union-attr]
    feather = replace(arm, robot=replace(spatial_3r, links=(*spatial_3r.links[:2], light)))
    gains = gains_from_prior(feather.model, [feather.log(False, 0.05)], preprocessing=GIVEN)
    assert [gain.known for gain in gains.gains] == [True, True, False]
    assert "use two runs with and without a known payload" in gains.gains[2].reason
    assert set(gains.by_joint()) == {"joint1", "joint2"}
    assert gains.figures()["complete"] is False


@pytest.mark.parametrize("signed", [False, True])
def test_currents_that_lag_are_put_beside_their_motion(spatial_3r: Robot, signed: bool) -> None:
    """The delay is found with the gains of a first fit, and is that of each log."""
    arm = replace(LoadedArm(spatial_3r, GAINS, ("viscous",)), rate=200.0)
    log = arm.log(False, 0.01)
    assert log.current is not None
    late = replace(log.rows(slice(4, None), "late"), current=log.current[:-4])
    gains = gains_from_prior(
        arm.model, [log, late], preprocessing=replace(GIVEN, delay_s=None), options=GainOptions(signed=signed)
    )
    np.testing.assert_allclose(gains.delays, [0.0, 0.02], atol=1e-3)
    found = [gain.value for gain in gains.gains]
    np.testing.assert_allclose(found, np.repeat(GAINS, 1 + signed), rtol=0.01)
    blind = gains_from_prior(
        arm.model, [late], preprocessing=replace(GIVEN, delay_s=0.0), options=GainOptions(signed=signed)
    )
    assert blind.delays == () and np.abs([g.value for g in blind.gains] / np.repeat(GAINS, 1 + signed) - 1).max() > 0.02


def test_what_cannot_be_asked_for_is_refused(spatial_3r: Robot) -> None:
    arm = LoadedArm(spatial_3r, GAINS)
    log = arm.log(False)
    with pytest.raises(BadOption, match="only 'structured' takes bodies"):
        gains_from_prior(arm.model, [log], share=0.1, preprocessing=GIVEN, options=GainOptions(method="tls"))
    with pytest.raises(BadOption, match="prior_share"):
        gains_from_prior(arm.model, [log], share=-0.1, preprocessing=GIVEN)
    bare = replace(spatial_3r, links=(replace(spatial_3r.links[0], inertia=None), *spatial_3r.links[1:]))
    with pytest.raises(BadOption, match="none for link1"):
        gains_from_prior(replace(arm.model, robot=bare), [log], preprocessing=GIVEN)


@pytest.mark.parametrize("coupled", [False, True])
def test_slopes_by_the_gains_are_those_of_fits_with_other_gains(
    spatial_3r: Robot, coupled_arm: Robot, coupled: bool
) -> None:
    robot = coupled_arm if coupled else spatial_3r
    arm = LoadedArm(robot, GAINS)
    log = arm.log(False, 0.02)
    weights = np.array([1.0, 2.0, 0.5])

    def problem(factors: np.ndarray):
        gains = dict(zip(robot.joint_names, GAINS * factors, strict=True))
        return build_problem(arm.model, [torque_from_current(log, gains, robot.coupling)], GIVEN)

    def fitted(factors: np.ndarray) -> np.ndarray:
        reduced = problem(factors).reduced(weights)
        return np.linalg.solve(reduced.r, reduced.z)

    slopes = gain_slopes(problem(np.ones(3)), weights)
    for k in range(3):
        step = 1e-3 * np.eye(3)[k]
        wanted = (fitted(1 + step) - fitted(1 - step)) / 2e-3  # exact: the fit is linear in the gains
        np.testing.assert_allclose(slopes[:, k], wanted, rtol=1e-6, atol=1e-9 * np.abs(wanted).max())


def test_an_estimate_states_what_its_gains_add(spatial_3r: Robot) -> None:
    arm = LoadedArm(spatial_3r, GAINS)
    drives = {
        name: Drive(gain=gain, gain_deviation=0.03) for name, gain in zip(spatial_3r.joint_names, GAINS, strict=True)
    }
    model = replace(arm.model, robot=spatial_3r.with_drives(drives))
    gains = dict(zip(spatial_3r.joint_names, GAINS, strict=True))
    problem = build_problem(model, [torque_from_current(arm.log(False, 0.02), gains)], GIVEN)
    estimate = fit(problem, WLS())
    stated = estimate.choices.gain_std
    assert stated is not None
    assert stated.relative == dict.fromkeys(gains, 0.03)
    assert len(stated.parameters) == estimate.base.count
    assert any("drive gains have a relative std of 3 %:" in text for text in warnings_of(estimate))
    plain = replace(problem, model=arm.model)
    assert gain_uncertainty(plain, np.ones(3)) is None
