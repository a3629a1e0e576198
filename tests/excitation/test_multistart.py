"""Starts in processes, kept in a file, and designed one run after the other."""

from __future__ import annotations

import json
import multiprocessing
import pickle
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.errors import BadOption, FileError, InfeasibleTrajectory
from dynident.excitation.design import multistart
from dynident.excitation.design.excitation import design_excitation
from dynident.excitation.design.multistart import SearchState
from dynident.excitation.design.options import DesignKnowledge, SearchOptions, TrajectoryOptions
from dynident.excitation.design.plan import Plan
from dynident.excitation.design.prior import Prior, prior_of_covariance
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.joint import JointLimits
from dynident.model.robot import Robot

LIMITS = JointLimits(-2.0, 1.5, 2.0, 8.0, 60.0, 150.0)
SHAPE = TrajectoryOptions(period=6.0, harmonics=3, samples=60)
SEARCH = SearchOptions(starts=3)
QUICK: dict[str, Any] = {"trajectory": SHAPE, "search": SEARCH}


@pytest.fixture(scope="module")
def model(planar_2r: Robot) -> DynamicModel:
    joints = tuple(replace(joint, limits=LIMITS) for joint in planar_2r.joints)
    return DynamicModel(replace(planar_2r, joints=joints), ("coulomb", "viscous", "offset"))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def plan(model: DynamicModel) -> Plan:
    return design_excitation(model, **QUICK)


def tables(plan: Plan) -> Array:
    return np.asarray(plan.trajectory.table)


# --- processes ---------------------------------------------------------------------------------------------------


def test_processes_find_the_same_plan_and_tell_how_far_they_are(model: DynamicModel, plan: Plan) -> None:
    seen: list[SearchState] = []
    other = design_excitation(model, trajectory=SHAPE, search=replace(SEARCH, jobs=2), progress=seen.append)
    np.testing.assert_array_equal(tables(other), tables(plan))
    assert other.settings["best_start"] == plan.settings["best_start"]
    assert other.settings["evaluations"] == plan.settings["evaluations"] == seen[-1].evaluations
    ends = [state.finished for state in seen]
    assert ends == sorted(ends) and seen[-1].finished == seen[-1].starts == 3
    assert {state.start for state in seen} == {1, 2, 3}
    done = [state for before, state in zip([0, *ends], seen, strict=False) if state.finished > before]
    assert len(done) == 3 and max(state.figure for state in done) == pytest.approx(plan.values["d_optimal"], abs=1e-9)
    assert all(0.9 < state.used <= 1.0 and " of joint" in state.worst for state in done)


def test_ctrl_c_ends_the_workers_at_once(model: DynamicModel) -> None:
    def stop(state: SearchState) -> None:
        raise KeyboardInterrupt

    before = set(threading.enumerate())
    with pytest.raises(KeyboardInterrupt):
        design_excitation(model, trajectory=SHAPE, search=replace(SEARCH, starts=200, jobs=2), progress=stop)
    assert not [thread for thread in set(threading.enumerate()) - before if "QueueFeeder" in thread.name]
    assert not multiprocessing.active_children()


_PARENT = """
import time
from dynident.workers.processes import Processes

class Sleep:
    def prepare(self):
        pass

    def do(self, task, tell):
        print("ready", flush=True)
        time.sleep(60)

if __name__ == "__main__":
    list(Processes(1).run(Sleep(), [0]))
"""


def test_workers_end_when_the_search_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(_PARENT)
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None and parent.stdout.readline() == "ready\n"
        parent.kill()
        began = time.monotonic()
        assert parent.stdout.read() == ""  # the end of the pipe comes when the worker, who holds it too, has ended
        assert time.monotonic() - began < 30


def test_an_error_of_a_worker_is_the_error_of_the_search(model: DynamicModel) -> None:
    weak = replace(LIMITS, lower=-0.4, upper=0.4, effort=5.0)
    joints = tuple(replace(joint, limits=weak) for joint in model.robot.joints)
    with pytest.raises(InfeasibleTrajectory, match="torque of joint1") as caught:
        design_excitation(
            replace(model, robot=replace(model.robot, joints=joints)), trajectory=SHAPE, search=replace(SEARCH, jobs=2)
        )
    assert caught.value.bound == "the torque of joint1"


def test_errors_come_whole_from_another_process() -> None:
    error = pickle.loads(pickle.dumps(FileError("a.json", "it is odd", "mend it")))
    assert isinstance(error, FileError) and str(error) == "a.json: it is odd; mend it" and error.step == "mend it"


@pytest.mark.parametrize("jobs", [0, -1])
def test_a_number_of_processes_that_is_none(model: DynamicModel, jobs: int) -> None:
    with pytest.raises(BadOption, match=f"jobs = {jobs} is not possible; give 1 or more"):
        design_excitation(model, trajectory=SHAPE, search=replace(SEARCH, jobs=jobs))


# --- finished starts in a file -----------------------------------------------------------------------------------


def test_a_search_goes_on_where_it_stopped(
    model: DynamicModel, plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "search.json"
    searched: list[int] = []
    inner = multistart.run_start
    monkeypatch.setattr(multistart, "run_start", lambda p, k, *rest: searched.append(k) or inner(p, k, *rest))

    def stop(state: SearchState) -> None:
        if state.finished == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        design_excitation(model, trajectory=SHAPE, search=replace(SEARCH, checkpoint=file), progress=stop)
    assert list(json.loads(file.read_text())["starts"]) == ["1", "2"]
    again = design_excitation(model, trajectory=SHAPE, search=replace(SEARCH, checkpoint=file))
    assert searched == [1, 2, 3]
    np.testing.assert_array_equal(tables(again), tables(plan))
    assert again.settings["evaluations"] == plan.settings["evaluations"]
    more = design_excitation(model, trajectory=SHAPE, search=replace(SEARCH, starts=5, checkpoint=file))
    assert searched == [1, 2, 3, 4, 5]
    assert more.values["d_optimal"] >= plan.values["d_optimal"]


def test_starts_of_another_problem_are_refused(model: DynamicModel, tmp_path: Path) -> None:
    file = tmp_path / "search.json"
    search = replace(SEARCH, starts=1, checkpoint=file)
    one: dict[str, Any] = {"trajectory": SHAPE, "search": search}
    design_excitation(model, **one)
    changes: list[tuple[dict[str, Any], str]] = [
        ({"knowledge": DesignKnowledge(noise=2.0)}, "noise"),
        ({"criterion": "condition", "knowledge": DesignKnowledge(noise=2.0)}, "criterion, noise"),
        ({"search": replace(search, seed=1)}, "seed"),
        ({"trajectory": replace(SHAPE, period=7.0)}, "trajectory"),
    ]
    for change, word in changes:
        with pytest.raises(FileError, match=f"of another problem; different: {word}; give the options of that search"):
            design_excitation(model, **{**one, **change})
    lighter = replace(model.robot.links[0], inertia=None)
    robot = replace(model.robot, links=(lighter, *model.robot.links[1:]))
    with pytest.raises(FileError, match="different: robot, torque parameters"):
        design_excitation(replace(model, robot=robot), **one)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not JSON"),
        ('{"kind": "dynident plan"}', "no search"),
        ("[1]", "no search"),
        ('{"kind": "dynident search", "format": 99}', "a search of version 99; .*; update dynident"),
    ],
)
def test_a_file_of_starts_that_is_none(model: DynamicModel, tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "search.json"
    file.write_text(text)
    with pytest.raises(FileError, match=message):
        design_excitation(model, trajectory=SHAPE, search=replace(SEARCH, checkpoint=file))
    assert file.read_text() == text


def test_a_damaged_file_of_starts_is_refused(model: DynamicModel, tmp_path: Path) -> None:
    file = tmp_path / "search.json"
    search = replace(SEARCH, starts=1, checkpoint=file)
    one: dict[str, Any] = {"trajectory": SHAPE, "search": search}
    design_excitation(model, **one)
    data = json.loads(file.read_text())
    data["starts"]["1"]["candidates"][0]["free"].pop()
    file.write_text(json.dumps(data))
    with pytest.raises(FileError, match=r"damaged .*finite numbers"):
        design_excitation(model, **one)


# --- one run after the other -------------------------------------------------------------------------------------


def largest_after(plan: Plan) -> float:
    """Return the largest relative standard deviation after the run."""
    found = [item["std_after"] / abs(item["value"]) for item in plan.settings["outlook"]["parameters"]]
    return max(found)


@pytest.mark.parametrize("criterion", ["a_optimal", "bayesian_d", "d_optimal", "e_optimal"])
def test_a_run_designed_after_another_tells_more_than_the_same_run_again(criterion: str, model: DynamicModel) -> None:
    noise = [1.0, 1.0]
    first = design_excitation(model, criterion=criterion, knowledge=DesignKnowledge(noise=noise), **QUICK)
    information, outlook = run_information(model, first, noise), first.settings["outlook"]["parameters"]
    beta = np.array([item["value"] or 1.0 for item in outlook])  # friction is not stated
    if criterion != "bayesian_d":  # which counts the nominal model as well
        expected = np.sqrt(np.diagonal(np.linalg.inv(information)))
        np.testing.assert_allclose([item["std_after"] for item in outlook], expected, rtol=1e-6)
    earlier = Prior(information, beta, "run 1")
    second = design_excitation(
        model,
        criterion=criterion,
        knowledge=DesignKnowledge(noise=noise, earlier=earlier),
        trajectory=SHAPE,
        search=replace(SEARCH, seed=1),
    )
    again = np.sqrt(np.diagonal(np.linalg.inv(2 * information))) / np.abs(beta)
    assert largest_after(second) < 0.95 * again.max()
    assert second.settings["outlook"]["before"].startswith("run 1")


def run_information(model: DynamicModel, plan: Plan, noise: list[float]) -> Array:
    """Return the information of 200 samples a second of one period, from the whole regressor."""
    from dynident.model.friction import Motion

    count = 1200
    motion = Motion(*plan.trajectory.evaluate(np.arange(600) * plan.trajectory.period / 600))
    rows = model.regressor(motion)[..., base_parameters(model).independent] / np.array(noise)[None, :, None]
    return np.asarray(np.einsum("sik,sil->kl", rows, rows) * count / 600)


def test_what_is_known_already_is_left_alone(model: DynamicModel) -> None:
    """With everything else known, the motion serves the one parameter that is not."""
    base = base_parameters(model)
    plain = design_excitation(model, knowledge=DesignKnowledge(noise=1.0), **QUICK)
    target = base.count - 1
    known = np.full(base.count, 1e8)
    known[target] = 0.0
    focused = design_excitation(
        model, knowledge=DesignKnowledge(noise=1.0, earlier=Prior(np.diag(known), None, "a table")), **QUICK
    )
    key = "std_after"
    shares = [p.settings["outlook"]["parameters"][target][key] for p in (focused, plain)]
    assert shares[0] < shares[1]


def test_earlier_runs_of_another_model_or_beside_a_condition_number(model: DynamicModel) -> None:
    with pytest.raises(BadOption, match=r"earlier = 'of 2 base parameters'.*use the same robot and friction"):
        design_excitation(
            model, knowledge=DesignKnowledge(earlier=prior_of_covariance(np.eye(2), None, "a.json")), **QUICK
        )
    with pytest.raises(BadOption, match=r"criterion = 'condition'.*choose one of: a_optimal, bayesian_d, d_optimal"):
        design_excitation(
            model, criterion="condition", knowledge=DesignKnowledge(earlier=Prior(np.eye(2), None, "a.json")), **QUICK
        )
    with pytest.raises(BadOption, match=r"rows = 0\.0"):
        design_excitation(model, knowledge=DesignKnowledge(rows=0.0), **QUICK)


def test_a_nominal_prior_needs_a_nominal_model(model: DynamicModel) -> None:
    bare = replace(model, robot=replace(model.robot, links=tuple(replace(k, inertia=None) for k in model.robot.links)))
    with pytest.raises(BadOption, match=r"deviation = 0\.5 is not possible; the robot model has no inertias"):
        design_excitation(bare, criterion="bayesian_d", **QUICK)
