"""Programs of robots, parsed and run by small readers: what they drive is the design to the printed round-off."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driven_plans import plan_of
from robot_programs import Module, run_krl, run_rapid, run_urscript

from dynident.errors import BadOption, FileError, UnknownChoice
from dynident.excitation.design.plan import Plan
from dynident.exports.motions import MOTION_EXPORTERS, Playback, export_motion

HOSTILE = ("a\nend\nset_digital_out(0, True)", "b;HALT", "c!]]", "{d}", 'e"', "f#" + "x" * 200)

ONCE = Playback()


def drive(plan: Plan, name: str, path: Path, playback: Playback = ONCE, **asked: Any) -> Module:
    export_motion(plan, MOTION_EXPORTERS.make(name, asked), path, playback)
    text = path.read_text("ascii")
    return run_krl(text, path.with_suffix(".dat").read_text("ascii")) if name == "krl" else run_rapid(text)


def table(module: Module, axes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return the times and the axes in printed units of the timed targets."""
    return np.array([t for t, _ in module.timed]), np.array(
        [[point[axis] for axis in axes] for _, point in module.timed]
    )


# --- Universal Robots ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("rate", "speed", "repeats"), [(125.0, 100.0, 1), (500.0, 50.0, 1), (62.5, 100.0, 2)])
@pytest.mark.parametrize("run_in", [0.0, 1.0])
def test_a_script_servos_the_designed_positions(
    rate: float, speed: float, repeats: int, run_in: float, tmp_path: Path
) -> None:
    plan = plan_of(run_in=run_in)
    found = export_motion(
        plan,
        MOTION_EXPORTERS.make("urscript", {"gain": 500.0}),
        tmp_path / "go.script",
        playback=Playback(rate=rate, speed=speed, repeats=repeats),
    )
    script = run_urscript((tmp_path / "go.script").read_text("ascii"))
    motion = plan.motion(repeats)
    time = np.arange(found.points) / rate
    exact = motion.evaluate(np.minimum(time * speed / 100, motion.duration))[0]
    np.testing.assert_allclose(np.array(script.servo)[: found.points], exact, rtol=0, atol=0.51e-8)
    assert time[-2] < motion.duration * 100 / speed <= time[-1] + 1e-9
    held = script.servo[found.points :]
    assert len(held) == np.ceil(0.5 * rate) and all(q == script.servo[found.points - 1] for q in held)
    (settings,) = script.settings
    assert settings == pytest.approx((0, 0, 1 / rate, 0.1, 500)) and script.stopped
    np.testing.assert_allclose(script.moves, exact[:1], rtol=0, atol=0.51e-8)
    assert found.round_off["joint1"] == pytest.approx(0.5e-8)


def test_a_script_goes_by_the_stated_posture(tmp_path: Path) -> None:
    posture = [0.5, -0.25, 0.0, 1.0, -1.0, 0.125]
    found = export_motion(plan_of(), "urscript", tmp_path / "go.script", playback=Playback(from_posture=posture))
    script = run_urscript((tmp_path / "go.script").read_text("ascii"))
    assert script.moves[0] == posture and len(script.moves) == 2
    assert found.approach == "a slow move of the controller (urscript) by the stated posture"


def test_a_script_states_speed_and_plan(tmp_path: Path) -> None:
    found = export_motion(plan_of(), "urscript", tmp_path / "go.script", playback=Playback(speed=25))
    text = (tmp_path / "go.script").read_text("ascii")
    assert "# speed: 25 % of the design: same path, speeds x 0.25, accelerations x 0.0625" in text
    assert found.plan_sha256 in text and "servoj steps last longer" in text


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"gain": 99.0}, "gain = 99.0 is not possible; servoj takes 100 to 2000"),
        ({"gain": np.nan}, "gain"),
        ({"lookahead": 0.3}, "lookahead = 0.3 is not possible; servoj takes 0.03 to 0.2 s"),
        ({"most_points": 100}, "the motion has 751 postures; lower --rate"),
    ],
)
def test_what_servoj_does_not_take(asked: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(BadOption, match=re.escape(message)):
        export_motion(plan_of(), MOTION_EXPORTERS.make("urscript", asked), tmp_path / "go.script")
    with pytest.raises(BadOption, match="whole multiples of 2 ms: 500, 250"):
        export_motion(plan_of(), "urscript", tmp_path / "go.script", Playback(rate=200.0))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("plan", [plan_of(7), plan_of(6, sliding=[2])])
def test_a_script_is_for_six_turning_joints(plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(BadOption, match="it takes 6 turning joints"):
        export_motion(plan, "urscript", tmp_path / "go.script")


# --- KUKA and ABB ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "file"), [("krl", "go.src"), ("rapid", "go.mod")])
@pytest.mark.parametrize(("speed", "repeats", "run_in"), [(100.0, 1, 0.0), (20.0, 1, 1.0), (100.0, 3, 0.0)])
def test_targets_are_the_design_at_their_times(
    name: str, file: str, speed: float, repeats: int, run_in: float, tmp_path: Path
) -> None:
    plan = plan_of(run_in=run_in)
    found = export_motion(plan, name, tmp_path / file, playback=Playback(speed=speed, repeats=repeats))
    module = drive(plan, name, tmp_path / file, Playback(speed=speed, repeats=repeats))
    axes = [f"A{i}" if name == "krl" else f"rax_{i}" for i in range(1, 7)]
    time, targets = table(module, axes)
    motion = plan.motion(repeats)
    assert module.name == "go" and len(time) == found.points - 1
    assert time[-1] == pytest.approx(motion.duration * 100 / speed, abs=1e-3)
    knots = np.linspace(0, motion.duration, found.points)[1:]
    np.testing.assert_allclose(time * speed / 100, knots, atol=1e-3 * speed / 100)  # printed microseconds add up
    np.testing.assert_allclose(targets, np.degrees(motion.evaluate(knots)[0]), rtol=0, atol=0.51e-5)
    first = np.degrees(motion.evaluate(0.0)[0][0])
    np.testing.assert_allclose([module.slow[-1][axis] for axis in axes], first, rtol=0, atol=0.51e-5)
    assert len(module.slow) == 1


@pytest.mark.parametrize(("name", "file"), [("krl", "go.src"), ("rapid", "go.mod")])
def test_the_reported_deviation_is_that_of_the_interpolation(name: str, file: str, tmp_path: Path) -> None:
    from scipy.interpolate import CubicSpline

    plan = plan_of()
    for tolerance in (0.5, 0.05):
        found = export_motion(plan, MOTION_EXPORTERS.make(name, {"tolerance": tolerance}), tmp_path / file)
        module = drive(plan, name, tmp_path / file, tolerance=tolerance)
        axes = [f"A{i}" if name == "krl" else f"rax_{i}" for i in range(1, 7)]
        _, targets = table(module, axes)
        targets = np.vstack([[module.slow[0][axis] for axis in axes], targets])
        knots = np.linspace(0, 6, found.points)
        time = np.linspace(0, 6, 6001)
        if name == "krl":
            way = CubicSpline(knots, targets, bc_type="clamped")(time)
        else:
            way = np.stack([np.interp(time, knots, column) for column in targets.T], axis=1)
        away = np.abs(way - np.degrees(plan.motion().evaluate(time)[0])).max(axis=0)
        stated = np.array(list(found.figures.deviation.values()))
        assert np.all(stated <= tolerance)
        np.testing.assert_allclose(away, stated, rtol=0.05, atol=2e-5)
    assert found.points > 12


@pytest.mark.parametrize(("name", "file"), [("krl", "go.src"), ("rapid", "go.mod")])
def test_the_seventh_joint_is_external_or_the_one_that_is_named(name: str, file: str, tmp_path: Path) -> None:
    plan = plan_of(7, sliding=[0])
    first = plan.motion().evaluate(0.0)[0][0]
    outside = "E1" if name == "krl" else "eax_a"
    robot = "A1" if name == "krl" else "rax_1"
    module = drive(plan, name, tmp_path / file)
    assert module.slow[0][outside] == pytest.approx(np.degrees(first[6]), abs=1e-5)
    assert module.slow[0][robot] == pytest.approx(1000 * first[0], abs=1e-5)  # a slide, in mm
    module = drive(plan, name, tmp_path / file, external="joint1")
    assert module.slow[0][outside] == pytest.approx(1000 * first[0], abs=1e-5)
    assert module.slow[0][robot] == pytest.approx(np.degrees(first[1]), abs=1e-5)


@pytest.mark.parametrize(("name", "file"), [("krl", "go.src"), ("rapid", "go.mod")])
def test_what_a_controller_of_axes_does_not_take(name: str, file: str, tmp_path: Path) -> None:
    for asked, message in [
        ({"tolerance": 0.0}, "tolerance = 0.0"),
        ({"tolerance": 1e-10}, "more than"),
        ({"most_points": 3}, "give 16 or more"),
        ({"external": "joint1,joint1"}, "external = 'joint1,joint1' is not possible"),
    ]:
        with pytest.raises(BadOption, match=re.escape(message)):
            export_motion(plan_of(), MOTION_EXPORTERS.make(name, asked), tmp_path / file)
    with pytest.raises(BadOption, match="has no rate: its points are thinned"):
        export_motion(plan_of(), name, tmp_path / file, Playback(rate=100.0))
    with pytest.raises(UnknownChoice, match="no joint called 'joint9'"):
        export_motion(plan_of(), MOTION_EXPORTERS.make(name, {"external": "joint9"}), tmp_path / file)
    with pytest.raises(BadOption, match="1 to 6 joints are robot axes"):
        export_motion(plan_of(13), name, tmp_path / file)
    with pytest.raises(BadOption, match="zone"):
        export_motion(plan_of(), MOTION_EXPORTERS.make("rapid", {"zone": "z3"}), tmp_path / "go.mod")
    assert not list(tmp_path.iterdir())


def test_few_axes_leave_the_rest_alone(tmp_path: Path) -> None:
    plan = plan_of(3)
    assert set(drive(plan, "krl", tmp_path / "go.src").slow[0]) == {"A1", "A2", "A3"}
    assert drive(plan, "rapid", tmp_path / "go.mod").slow[0]["rax_4"] == 0


@pytest.mark.parametrize(("name", "file"), [("krl", "go.src"), ("rapid", "go.mod")])
def test_a_stated_posture_is_passed_slowly(name: str, file: str, tmp_path: Path) -> None:
    module = drive(plan_of(), name, tmp_path / file, Playback(from_posture=np.full(6, 0.5)))
    assert len(module.slow) == 2
    np.testing.assert_allclose(list(module.slow[0].values())[:6], np.degrees(0.5), atol=1e-5)


def test_the_spline_is_no_faster_than_the_share_where_its_times_are_not_kept(tmp_path: Path) -> None:
    export_motion(plan_of(), "krl", tmp_path / "go.src", playback=Playback(speed=20))
    lines = (tmp_path / "go.src").read_text("ascii").splitlines()
    start = lines.index("PTP_SPLINE")
    assert lines[start - 2 : start] == ["BAS(#VEL_PTP,20)", "BAS(#ACC_PTP,20)"]


# --- names -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "suffix"), [("urscript", ".script"), ("krl", ".src"), ("rapid", ".mod")])
@pytest.mark.parametrize("stem", ["1st", "a b", "a-b", "é", "a;HALT", "a" * 65, "_a", "IF", "while"])
def test_program_names_are_words(name: str, suffix: str, stem: str, tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot name a program in"):
        export_motion(plan_of(), name, tmp_path / f"{stem}{suffix}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("name", "stem"), [("urscript", "p0"), ("krl", "qp"), ("rapid", "SLOW")])
def test_programs_are_not_named_as_what_stands_in_them(name: str, stem: str, tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot name a program in"):
        export_motion(plan_of(), name, tmp_path / f"{stem}.src")


def test_names_are_as_long_as_the_language_takes(tmp_path: Path) -> None:
    export_motion(plan_of(), "krl", tmp_path / f"{'k' * 24}.src")
    with pytest.raises(FileError, match="24 at most"):
        export_motion(plan_of(), "krl", tmp_path / f"{'k' * 25}.src")
    export_motion(plan_of(), "rapid", tmp_path / f"{'r' * 28}.mod")
    with pytest.raises(FileError, match="28 at most"):
        export_motion(plan_of(), "rapid", tmp_path / f"{'r' * 29}.mod")
    with pytest.raises(FileError, match=r"give it the suffix \.src"):
        export_motion(plan_of(), "krl", tmp_path / "k.dat")


@pytest.mark.parametrize(("name", "file"), [("urscript", "go.script"), ("krl", "go.src"), ("rapid", "go.mod")])
def test_hostile_joint_names_stay_in_comments(name: str, file: str, tmp_path: Path) -> None:
    calm, hostile = plan_of(), plan_of(names=HOSTILE)
    sign = {"urscript": "#", "krl": ";", "rapid": "!"}[name]

    def code(plan: Plan) -> list[str]:
        export_motion(plan, name, tmp_path / file)
        text = (tmp_path / file).read_text("ascii")
        return [line for line in text.splitlines() if not line.strip().startswith(sign)]

    assert code(calm) == code(hostile)
    found = export_motion(hostile, name, tmp_path / file)
    assert any("'b;HALT' stands in comments as b_HALT" in note for note in found.notes)
    assert len(found.notes) >= 6
