"""Golden messages: what happened, the evidence, the next step; one line each."""

from __future__ import annotations

import inspect

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident import errors
from dynident.errors import DynidentError, nearest

GOLDEN = [
    (
        errors.UnknownChoice("estimator", "wsl", ["consistent", "ols", "wls"]),
        "no estimator called 'wsl'; choose one of: consistent, ols, wls; did you mean 'wls'?",
    ),
    (
        errors.UnknownChoice("joint", "zzz", ["shoulder", "elbow"]),
        "no joint called 'zzz'; choose one of: shoulder, elbow",
    ),
    (
        errors.BrokenPart("estimator", "pull", "loading x.pull ends with OSError: no", "mend or uninstall 'x'"),
        "the estimator 'pull' cannot be used: loading x.pull ends with OSError: no; mend or uninstall 'x'",
    ),
    (
        errors.MissingDependency("'rosbag'", "rosbags", "ros"),
        "'rosbag' needs the package 'rosbags'; install it with: pip install 'dynident[ros]'",
    ),
    (
        errors.FileError("run.csv", "there is no such file", "check the path"),
        "run.csv: there is no such file; check the path",
    ),
    (
        errors.DescriptionError("arm.urdf", "link 'l3'", "mass value '1,5' is not a number", "write a point: 1.5"),
        "arm.urdf: link 'l3': mass value '1,5' is not a number; write a point: 1.5",
    ),
    (
        errors.DescriptionError("arm.urdf", "", "the file is empty", "give a URDF"),
        "arm.urdf: the file is empty; give a URDF",
    ),
    (
        errors.LogFormatError("run.csv", 1, "no column 'tau1'", "the header has t, q1"),
        "run.csv:1: no column 'tau1'; the header has t, q1",
    ),
    (
        errors.NoNumbers("run.csv", 1, ["tau1"], "tau1: not finite in 9 of 9 rows", "read other columns"),
        "run.csv:1: tau1: not finite in 9 of 9 rows; read other columns",
    ),
    (errors.LogFormatError("run.csv", None, "the file is empty", "record"), "run.csv: the file is empty; record"),
    (
        errors.LogMismatch("run.csv", "no joint called 'elbow'", "the log has a, b"),
        "run.csv: no joint called 'elbow'; the log has a, b",
    ),
    (
        errors.BadArgument("q", "shape (6, 500) where (500, 6) is wanted", "write q.T"),
        "q: shape (6, 500) where (500, 6) is wanted; write q.T",
    ),
    (errors.BadOption("iterations", 0, "give 1 or more"), "iterations = 0 is not possible; give 1 or more"),
    (
        errors.PoorExcitation(8, 10, "undetermined: Izz[link2]", "move all joints"),
        "the log determines 8 of 10 base parameters (undetermined: Izz[link2]); move all joints",
    ),
    (
        errors.ContradictoryConstraints("link1: mass >= 5 kg; total mass <= 4 kg", "relax one of them"),
        "no robot meets all constraints: link1: mass >= 5 kg; total mass <= 4 kg; relax one of them",
    ),
    (
        errors.NotConsistent("link2", "the mass is -1 kg", "use the consistent estimator"),
        "link2 is not physically consistent: the mass is -1 kg; use the consistent estimator",
    ),
    (
        errors.SolverFailed("the consistent fit", "status MaxIterations", "check the units"),
        "the consistent fit found no solution: status MaxIterations; check the units",
    ),
    (
        errors.InfeasibleTrajectory("torque of joint2", "every posture needs 1.3 times it", "check the masses"),
        "no motion keeps the limits, above all torque of joint2: every posture needs 1.3 times it; check the masses",
    ),
    (
        errors.NotAccepted("run.csv", "torque sign (joint2): friction drives it", "negate the column"),
        "run.csv: torque sign (joint2): friction drives it; negate the column",
    ),
    (errors.EstimateFormatError("e.json", "format 2", "identify again"), "e.json: format 2; identify again"),
    (
        errors.TriangleFileError("all.tri", "format 2", "reduce the logs again"),
        "all.tri: format 2; reduce the logs again",
    ),
    (
        errors.PoolFailed("the cluster at tcp://host:8786", "no worker in 60 s", "start one"),
        "the cluster at tcp://host:8786: no worker in 60 s; start one",
    ),
]


@pytest.mark.parametrize(("error", "message"), GOLDEN, ids=lambda value: type(value).__name__)
def test_message(error: DynidentError, message: str) -> None:
    assert str(error) == message
    assert "\n" not in message


def test_every_error_has_a_golden_message_and_one_root() -> None:
    found = [value for _, value in inspect.getmembers(errors, inspect.isclass) if value.__module__ == errors.__name__]
    classes = set(found) - {DynidentError}
    assert classes == {type(error) for error, _ in GOLDEN}
    assert all(issubclass(kind, DynidentError) for kind in classes)


@pytest.mark.parametrize("error", [error for error, _ in GOLDEN], ids=lambda value: type(value).__name__)
def test_the_facts_are_kept(error: DynidentError) -> None:
    facts = [name for name in inspect.signature(type(error)).parameters if name != "self"]
    assert all(hasattr(error, name) for name in facts)
    assert all(str(vars(error)[name]) in str(error) for name in facts if isinstance(vars(error)[name], str))


def test_paths_are_kept_as_text(tmp_path: object) -> None:
    assert errors.FileError(tmp_path, "a", "b").path == str(tmp_path)


def test_nearest() -> None:
    assert nearest("coulom", ["coulomb", "viscous"]) == "; did you mean 'coulomb'?"
    assert nearest("xyz", ["coulomb", "viscous"]) == ""
    assert nearest("xyz", []) == ""


@given(st.text(max_size=20), st.lists(st.text(max_size=20), max_size=5))
def test_nearest_names_only_what_is_there(word: str, choices: list[str]) -> None:
    found = nearest(word, choices)
    assert found == "" or any(found == f"; did you mean '{choice}'?" for choice in choices)
