"""What every exporter of motions must do, whatever it writes: one battery for the whole folder."""

from __future__ import annotations

import re
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.errors import BadOption, DynidentError, FileError
from dynident.excitation.design.limits import MotionLimits, check_limits
from dynident.excitation.design.plan import Plan
from dynident.excitation.trajectories.rest_fourier import RestFourier
from dynident.exports.base import Exporter
from dynident.exports.models import MODEL_EXPORTERS
from dynident.exports.motions import (
    MOTION_EXPORTERS,
    DrivenMotion,
    MotionExport,
    MotionExporter,
    Playback,
    Printed,
    export_motion,
    motion_export_data,
)

PARTS = MOTION_EXPORTERS.names()

#: Joints that a target asks for, where any number will not do.
JOINTS = {"libfranka": 7}

#: Values that no option of a kind may take in silence.
ABSURD = {"float": np.nan, "int": -1, "str": "no such\nthing"}


def file_of(name: str) -> str:
    return f"go{MOTION_EXPORTERS.get(name).suffix}"


def requirements(extra: str) -> list[str]:
    """Return the packages of an extra of dynident."""
    found = [re.match(r"([\w-]+).*extra == ['\"]([\w-]+)['\"]", line) for line in metadata.requires("dynident") or ()]
    return [match.group(1) for match in found if match and match.group(2) == extra]


def plan_of(joints: int, size: float = 0.1) -> Plan:
    """Return a plan of 3 s within round bounds."""
    trajectory = RestFourier.from_free(size * np.random.default_rng(5).normal(size=(joints, 5)), 3.0)
    ones = np.ones(joints)
    names = tuple(f"joint{i + 1}" for i in range(joints))
    limits = MotionLimits(names, (True,) * joints, -2 * ones, 2 * ones, 3 * ones, 40 * ones, 600 * ones, np.inf * ones)
    draft = Plan("arm", trajectory, 0.0, "condition", {}, limits, (), 1001, {})
    return replace(draft, rows=check_limits(draft.motion(), limits, draft.samples))


@pytest.fixture(params=PARTS)
def name(request: pytest.FixtureRequest) -> str:
    for needed in requirements(MOTION_EXPORTERS.get(request.param).extra):
        pytest.importorskip(needed)
    return request.param


AT_START = Playback(from_posture="start")


@pytest.fixture
def plan(name: str) -> Plan:
    return plan_of(JOINTS.get(name, 6))


def written(
    plan: Plan, name: str, folder: Path, playback: Playback = AT_START
) -> tuple[MotionExport, dict[str, bytes]]:
    """Export into a new folder and return what was told and the bytes of all files there."""
    folder.mkdir()
    found = export_motion(plan, name, folder / file_of(name), playback)
    files = {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    assert set(files) == {str(Path(file).relative_to(folder)) for file in found.files}
    return found, files


def printed(plan: Plan, name: str, **asked: Any) -> Printed:
    part = MOTION_EXPORTERS.make(name)
    assert isinstance(part, MotionExporter)
    content = part.content(DrivenMotion(plan, part.rate, **asked), Path(file_of(name)))
    assert content.printed is not None
    return content.printed


def test_a_part_says_what_it_takes_and_writes(name: str) -> None:
    part = MOTION_EXPORTERS.make(name)
    assert isinstance(part, Exporter) and part.takes == "plan"
    assert bool(part.suffix) != part.writes_folder and part.proof


@pytest.mark.parametrize(("speed", "repeats"), [(1.0, 1), (0.37, 2), (0.1, 1)])
def test_the_path_stays_and_time_stretches(name: str, plan: Plan, speed: float, repeats: int) -> None:
    """q(t) at a share s of the speed is the design's q(s t), whatever the rate; dq and ddq scale by s and s^2."""
    found = printed(plan, name, speed=speed, repeats=repeats)
    exact = plan.motion(repeats).evaluate(np.minimum(found.time * speed, plan.motion(repeats).duration))
    for k, signal in enumerate(found.signals):
        room = found.round_off[k] + 1e-8 * max(1.0, float(np.abs(exact[k]).max()))
        assert np.all(np.abs(signal - exact[k] * speed**k) <= room)
    assert found.time[-1] == pytest.approx(plan.motion(repeats).duration / speed, abs=0.011)


def test_it_starts_and_ends_at_rest_at_the_ends_of_the_plan(name: str, plan: Plan) -> None:
    found = printed(plan, name)
    motion = plan.motion()
    for place, moment in ((0, 0.0), (-1, motion.duration)):
        away = np.abs(found.signals[0, place] - motion.evaluate(moment)[0][0])
        assert np.all(away <= found.round_off[0] + 1e-9)
    assert not np.any(found.signals[1:, [0, -1]])
    steps = np.abs(np.diff(found.signals[0], axis=0)).max(axis=1)
    assert steps[0] < 0.2 * steps.max() and steps[-1] < 0.2 * steps.max()


def test_the_same_plan_gives_the_same_bytes(name: str, plan: Plan, tmp_path: Path) -> None:
    _, first = written(plan, name, tmp_path / "a")
    _, second = written(plan, name, tmp_path / "b")
    assert first == second


def test_a_check_writes_nothing_and_tells_the_same(name: str, plan: Plan, tmp_path: Path) -> None:
    target = tmp_path / file_of(name)
    checked = export_motion(plan, name, target, AT_START, write=False)
    assert not list(tmp_path.iterdir())
    assert motion_export_data(export_motion(plan, name, target, AT_START)) == motion_export_data(checked)


def test_what_is_told_is_true(name: str, plan: Plan, tmp_path: Path) -> None:
    found, files = written(plan, name, tmp_path / "a", replace(AT_START, speed=50, repeats=2))
    assert (
        all((tmp_path / "a" / file).parent.name == "go" for file in files) == MOTION_EXPORTERS.get(name).writes_folder
    )
    (proof,) = found.proofs
    assert (proof.states, proof.why_not) == (found.points, "") and proof.relative is not None
    assert proof.relative <= proof.allowed < 1e-6
    data = motion_export_data(found)
    assert (data["exporter"], data["robot"], data["speed"], data["repeats"]) == (name, "arm", 0.5, 2)
    assert data["duration"] == pytest.approx(12.0) and data["points"] == len(
        printed(plan, name, speed=0.5, repeats=2).time
    )
    full = {(row.joint, row.quantity): row for row in plan.rows}
    for row in found.rows:
        order = ("position", "velocity", "acceleration", "jerk").index(row.quantity)
        assert row.value == pytest.approx(full[row.joint, row.quantity].value * 0.5**order, rel=1e-4)
        assert row.limit == full[row.joint, row.quantity].limit and row.kept
    assert set(found.round_off) == set(plan.joints) and max(found.round_off.values()) < 1e-6


def test_torques_and_distances_are_those_of_the_plan_where_they_still_hold(name: str, plan: Plan) -> None:
    """Distances do not change with the speed; torques do, and a plan has no model."""
    torque = replace(plan.rows[0], quantity="torque", unit="N m", time=1.0)
    near = replace(plan.rows[0], joint="hand-floor", quantity="clearance", unit="m", time=2.0)
    whole = replace(plan, rows=(*plan.rows, torque, near))
    path = Path(file_of(name))
    assert export_motion(whole, name, path, AT_START, write=False).rows[-2:] == (torque, near)
    slow = export_motion(whole, name, path, playback=Playback(from_posture="start", speed=50), write=False).rows
    assert slow[-1] == replace(near, time=4.0) and "torque" not in {row.quantity for row in slow}


def test_a_plan_that_passes_a_bound_is_refused(name: str, tmp_path: Path) -> None:
    fast = plan_of(JOINTS.get(name, 6), size=3.0)
    assert not fast.feasible
    with pytest.raises(FileError, match=r"not written, because the \w+ of joint\d would be"):
        export_motion(fast, name, tmp_path / file_of(name), AT_START)
    assert not list(tmp_path.iterdir())


def test_numbers_that_are_none_are_refused(name: str, plan: Plan, tmp_path: Path) -> None:
    trajectory = RestFourier.from_free(np.zeros((len(plan.joints), 5)), 3.0)
    object.__setattr__(trajectory, "offset", np.full(len(plan.joints), np.nan))
    with pytest.raises(DynidentError, match=r"not a finite number|nan"):
        export_motion(replace(plan, trajectory=trajectory), name, tmp_path / file_of(name), AT_START)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("speed", [0.0, 9.99, 100.01, 200.0, -50.0, np.nan, np.inf])
def test_no_speed_above_the_design_or_below_a_tenth(name: str, plan: Plan, speed: float, tmp_path: Path) -> None:
    with pytest.raises(BadOption, match="give 10 to 100 per cent"):
        export_motion(plan, name, tmp_path / file_of(name), playback=Playback(speed=speed, from_posture="start"))


@pytest.mark.parametrize("asked", [{"rate": 0.0}, {"rate": np.nan}, {"rate": 1e9}, {"rate": -1.0}, {"repeats": 0}])
def test_rates_and_repeats_that_cannot_be(name: str, plan: Plan, asked: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(BadOption, match=next(iter(asked))):
        export_motion(plan, name, tmp_path / file_of(name), replace(AT_START, **asked))
    assert not list(tmp_path.iterdir())


def test_absurd_options_are_refused(name: str, plan: Plan, tmp_path: Path) -> None:
    for option in MOTION_EXPORTERS.options(name):
        if option.kind in ABSURD:
            with pytest.raises(DynidentError, match=re.escape(option.name) + "|joint"):
                part = MOTION_EXPORTERS.make(name, {option.name: ABSURD[option.kind]})
                export_motion(plan, part, tmp_path / file_of(name), AT_START)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there_is_named(name: str, plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(FileError, match="there is no folder"):
        export_motion(plan, name, tmp_path / "none" / file_of(name), AT_START)


def test_hostile_names_never_reach_a_program(name: str, plan: Plan, tmp_path: Path) -> None:
    """Names with ends of lines, quotes and brackets are refused, replaced or escaped; text stays plain ASCII."""
    hostile = ("a\nend", "b;x", "c]", 'd"', "e'", "f{}", "g\u2028h")[: len(plan.joints)]
    named = replace(plan, robot="r\n; HALT", limits=replace(plan.limits, joints=hostile), rows=())
    try:
        _, files = written(named, name, tmp_path / "a")
    except DynidentError as error:
        assert "joint" in str(error) and not list((tmp_path / "a").iterdir())
        return
    _, calm = written(plan, name, tmp_path / "b")
    for file, data in files.items():
        text = data.decode("ascii")
        assert text.count("\n") == calm[file].count(b"\n")


def test_a_part_of_another_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadOption, match="it does not export plans"):
        export_motion(plan_of(6), MODEL_EXPORTERS.make("csv"), tmp_path / "x")  # type: ignore[arg-type]
    with pytest.raises(BadOption, match="has the options"):
        export_motion(plan_of(6), MOTION_EXPORTERS.make("csv", {"radians": True}), tmp_path / "x")
