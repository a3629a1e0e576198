"""Springs and balancers: named with the part that models them, silent once the case has it, and what obeying brings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults.trials import Trial, virtual

from dynident.case.case import Case, read_case
from dynident.identification.identify import identify
from dynident.model.friction import Motion
from dynident.model.friction.balancer import Balancer
from dynident.model.friction.spring import Spring

BALANCER, STIFFNESS, FORCE, HOSE = Balancer(dead_center=-1.5, ratio=4.0), 600.0, -900.0, 15.0


@pytest.fixture(scope="module")
def six(tmp_path_factory: pytest.TempPathFactory) -> Case:
    path = tmp_path_factory.mktemp("case") / "case.yaml"
    path.write_text("case: 2\nrobot: generic-6r\nfriction: [coulomb, viscous, offset, rotor_inertia]\n")
    return read_case(path)


def sprung(case: Case, seed: int) -> Trial:
    """Return a log of an arm with a balancer at its second joint and a hose at its fifth."""
    trial = virtual(case, seed)
    q, torque = trial.columns["q"], np.array(trial.columns["tau"])
    at = Motion(q, 0 * q, 0 * q)
    torque[:, 1] += BALANCER.columns(at)[:, 1] @ [STIFFNESS, FORCE]
    torque[:, 4] += HOSE * q[:, 4]
    return trial.with_columns(tau=torque)


def with_parts(case: Case, balancer: Balancer = BALANCER) -> Case:
    names = case.robot.joint_names
    parts = (replace(balancer, joints=(names[1],)), Spring(joints=(names[4],)))
    return replace(case, friction=(*case.friction, *parts))


@pytest.mark.parametrize("seed", [0, 1])
def test_springs_are_named_with_their_part_and_joint(seed: int, six: Case, tmp_path: Path) -> None:
    trial = sprung(six, seed)
    findings = {(one.name, one.joint): one for one in trial.examined(tmp_path).findings}
    second, fifth = six.robot.joint_names[1], six.robot.joint_names[4]
    hose = findings["spring", fifth]
    assert f"add spring: {{joints: [{fifth}]}} to friction:" in hose.remedy
    assert hose.numbers["value"] == pytest.approx(HOSE, abs=max(hose.numbers["half_width"], 0.02 * HOSE))
    told = findings["counterbalance", second]
    assert f"add balancer: {{joints: [{second}], dead_center: -1." in told.remedy


@pytest.mark.parametrize(
    "stated", [BALANCER, Balancer(dead_center=-1.53, ratio=3.0, vary=("ratio",))], ids=["drawn", "found"]
)
@pytest.mark.parametrize("seed", [0, 1])
def test_nothing_is_said_of_springs_that_the_case_has(seed: int, stated: Balancer, six: Case, tmp_path: Path) -> None:
    trial = replace(sprung(six, seed), case=with_parts(six, stated))
    found = trial.examined(tmp_path).findings
    assert not [one for one in found if one.name in ("spring", "counterbalance")]
    assert not [one for one in found if one.severity != "note"]


@pytest.mark.parametrize("seed", [0, 1])
def test_a_balancer_of_another_geometry_is_to_be_stated_better(seed: int, six: Case, tmp_path: Path) -> None:
    trial = replace(sprung(six, seed), case=with_parts(six, Balancer(dead_center=-1.8, ratio=3.0)))
    second = six.robot.joint_names[1]
    told = [one for one in trial.examined(tmp_path).findings if one.joint == second and one.severity == "warning"]
    assert [one.remedy for one in told] == [
        "state dead_center, ratio of its balancer more exactly, or add vary: [ratio] to it"
    ]


def test_what_is_named_and_stated_is_no_mass_of_the_links(six: Case, tmp_path: Path) -> None:
    trial = sprung(six, 0)
    log = six.read(trial.written(tmp_path))
    stated, bare = (identify(one.model, [log], "consistent", six.preprocessing) for one in (with_parts(six), six))
    assert stated.train.total_relative_error < 0.6 * bare.train.total_relative_error
    values = {(p.symbol, p.owner): value for p, value in zip(stated.model.parameters, stated.theta, strict=True)}
    assert values["Kb", six.robot.joint_names[1]] == pytest.approx(STIFFNESS, rel=0.1)
    assert values["Fb", six.robot.joint_names[1]] == pytest.approx(FORCE, rel=0.1)
    assert values["Ks", six.robot.joint_names[4]] == pytest.approx(HOSE, rel=0.02)
    nominal = stated.model.nominal()
    assert nominal is not None
    is_mass = [p.symbol == "m" for p in stated.model.parameters]
    masses = [np.asarray(theta)[is_mass].sum() for theta in (stated.theta, nominal)]
    assert masses[0] == pytest.approx(masses[1], rel=0.1)
