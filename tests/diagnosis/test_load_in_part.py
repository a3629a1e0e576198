"""A load that is carried for a part of a log: when it is there, its mass, and what is none."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults.trials import RATE, Trial, virtual

from dynident.arrays import Array
from dynident.case.case import read_case
from dynident.diagnosis.examination import examine_logs
from dynident.model.inertia import Inertia

MASS, TOLD = 1.5, "load for a while"


@pytest.fixture(scope="module")
def plain() -> Trial:
    return virtual(read_case("generic-6r"), 1, RATE)


@pytest.fixture(scope="module")
def heavier(plain: Trial) -> Array:
    """Torques of the same motion with a body on the last link, shape (N, n)."""
    robot = plain.case.robot
    body = Inertia.from_centre_of_mass(MASS, np.array([0.03, 0.05, 0.1]), 0.003 * np.eye(3))
    own = robot.links[-1].inertia
    assert own is not None
    links = (*robot.links[:-1], replace(robot.links[-1], inertia=own + body))
    loaded = virtual(replace(plain.case, robot=replace(robot, links=links)), 1, RATE)
    np.testing.assert_array_equal(loaded.columns["q"], plain.columns["q"])
    return loaded.columns["tau"]


@pytest.mark.parametrize(
    "spells", [((3.0, 5.0),), ((-1.0, 6.0),), ((7.0, 99.0),), ((1.0, 2.5), (4.0, 6.0), (8.0, 9.5))]
)
def test_a_load_is_told_with_its_spells_and_mass(
    spells: tuple[tuple[float, float], ...], plain: Trial, heavier: Array, tmp_path: Path
) -> None:
    """Half a log with 3 kg was a load of 1.6 kg; two in four spells, a wrong scale of one joint's torque."""
    time = plain.columns["t"] - plain.columns["t"][0]
    there = np.any([(time > first) & (time < last) for first, last in spells], axis=0)
    trial = plain.with_columns(tau=np.where(there[:, None], heavier, plain.columns["tau"]))
    found = [one for one in trial.examined(tmp_path).findings if one.severity != "note"]
    assert [(one.severity, one.name) for one in found] == [("error", TOLD)]
    numbers = found[0].numbers
    assert abs(numbers["mass"] - MASS) < numbers["half_width"] < 0.3 * MASS
    assert numbers["first"] == pytest.approx(max(spells[0][0], 0.0), abs=0.6)
    assert numbers["last"] == pytest.approx(min(spells[-1][1], time[-1]), abs=0.6)
    assert found[0].evidence.count(" to ") == len(spells)


@pytest.mark.parametrize("other", ["nothing", "offset", "friction", "push", "always"])
def test_other_things_in_part_of_a_log_are_no_load(other: str, plain: Trial, heavier: Array, tmp_path: Path) -> None:
    time, tau = plain.columns["t"] - plain.columns["t"][0], plain.columns["tau"].copy()
    there, size = (time > 3.0) & (time < 6.0), tau.std(axis=0)
    speed = np.gradient(plain.columns["q"], plain.columns["t"], axis=0)
    if other == "offset":
        tau[there, 1] += 0.3 * size[1]
    if other == "friction":
        tau += 0.2 * size * np.tanh(speed / 0.01) * there[:, None]
    if other == "push":
        tau[:, 2] += 0.5 * size[2] * ((time > 4.0) & (time < 4.4))
    if other == "always":
        tau = heavier
    assert TOLD not in [one.name for one in plain.with_columns(tau=tau).examined(tmp_path).findings]


def test_a_right_log_beside_it_is_not_blamed_and_its_parts_are_right(
    plain: Trial, heavier: Array, tmp_path: Path
) -> None:
    """What the remedy asks for."""
    time = plain.columns["t"] - plain.columns["t"][0]
    mixed = plain.with_columns(tau=np.where((time < 5.0)[:, None], heavier, plain.columns["tau"]))
    logs = [str(mixed.written(tmp_path)), str(plain.written(tmp_path, "right"))]
    found = examine_logs(plain.case, logs)
    assert [one.sound for one in found] == [False, True]
    assert not [one.name for one in found[1].findings if one.severity != "note"]
    remedy = next(one.remedy for one in found[0].findings if one.name == TOLD)
    ((name, spells),) = re.findall(r"leave_out: \{(.*): (\[\[.*\]\])\}", remedy)
    columns = replace(plain.case.columns, leave_out=((name, tuple(map(tuple, json.loads(spells)))),))
    found = examine_logs(replace(plain.case, columns=columns), [str(mixed.written(tmp_path)), logs[1]])
    assert not [one.name for each in found for one in each.findings if one.severity != "note"]


@pytest.mark.battery
def test_loads_of_random_arms_are_told_with_their_spells(tmp_path: Path) -> None:
    part_loads = pytest.importorskip("benchmarks.faults.part_loads")
    named, held = 0, 0
    for seed in range(20, 30):
        mass, found = part_loads.told(seed, tmp_path)
        numbers = found.numbers
        named += found.right
        held += "mass" not in numbers or abs(numbers["mass"] - mass) <= numbers["half_width"]
        assert found.after < found.before
    assert named >= 9 and held >= 8
