"""Actuators as files of other programs: MuJoCo follows the roll-out, the others hold the same numbers."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml
from servo_bench import PENDULUM, motions, parameters, virtual_logs, write_csv

from dynident.actuators.drive_law import preset
from dynident.actuators.estimate import ActuatorEstimate, JointActuator, read_actuators, write_actuators
from dynident.actuators.joint_load import measured_loads
from dynident.actuators.parameters import PARAMETERS
from dynident.actuators.rollout import record_of, rolled_out
from dynident.actuators.verdict import Known
from dynident.actuators.virtual import ServoBench, virtual_log
from dynident.arrays import Array
from dynident.cli.main import main
from dynident.exports import actuator_proof
from dynident.exports.c_compiler import build_program, find_compiler, run_program
from dynident.model.robot import Robot
from dynident.robot_files import read_robot
from dynident.robot_files.robot_origin import robot_facts

KP = 4.0


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a robot model and the true actuator of its joint as an answer."""
    monkeypatch.chdir(tmp_path)
    Path("pendulum.urdf").write_text(PENDULUM)
    true = parameters(angle_offset=0.0)
    joint = JointActuator(
        "joint1", preset("feetech_sts3215"), (KP, 6.0), "m1", true, (), (), true, true, {}, {}, {}, {}, 0.0
    )
    write_actuators(ActuatorEstimate("pendulum", (joint,), {"robot": {"path": "pendulum.urdf"}}), "a.json")
    return tmp_path


def test_mujoco_follows_the_roll_out(folder: Path) -> None:
    """Within 3 mrad on average over chirp and steps with saturation, with its delay and force range."""
    assert main(["export", "a.json", "--to", "mjcf", "-o", "robot.xml", "--option", "kp=4", "--quiet"]) == 0
    model = mujoco.MjModel.from_xml_path("robot.xml")
    assert model.dof_armature[0] == pytest.approx(0.012) and model.dof_frictionloss[0] == pytest.approx(0.04)
    assert model.actuator_forcerange[0, 1] == pytest.approx(2.4 * 0.97)
    robot: Robot = read_robot("pendulum.urdf")
    time, each = motions()
    law, true = preset("feetech_sts3215"), parameters(angle_offset=0.0)
    for name in ("chirp", "steps"):
        command = each[name][0]
        log = next(one for one, key in zip(virtual_logs(robot, true, gains=(KP,)), each, strict=True) if key == name)
        log = type(log)(**{**vars(log), "time": time})
        record = record_of(log, 0, measured_loads(robot, log)[0], law)
        ours = rolled_out(record, true).q
        data = mujoco.MjData(model)
        data.qpos[0] = ours[0]
        steps = round((time[1] - time[0]) / model.opt.timestep)
        theirs = np.empty(len(time))
        for k in range(len(time)):
            theirs[k] = data.qpos[0]
            data.ctrl[0] = command[k]
            mujoco.mj_step(model, data, nstep=steps)
        assert np.mean(np.abs(theirs - ours)) < 3e-3, (name, np.mean(np.abs(theirs - ours)))


@pytest.mark.parametrize("limit", [np.inf, 2.0], ids=["no limit", "limited"])
def test_commanded_velocity_and_torque_of_mit_mode_in_mujoco(
    folder: Path, capsys: pytest.CaptureFixture[str], limit: float
) -> None:
    """By the words of the export, which its model holds too: within 3 mrad on average (1.2), far off without them."""
    kp, true = 9.0, parameters(full_torque=0.9, back_emf=0.0, damping_gain=0.6, angle_offset=0.0)
    law = preset("mit").stated({"damping_gain": 0.6, "limit": limit})
    joint = JointActuator("joint1", law, (kp,), "m1", true, (), (), true, true, {}, {}, {}, {}, 0.0)
    write_actuators(ActuatorEstimate("pendulum", (joint,), {"robot": {"path": "pendulum.urdf"}}), "a.json")
    Path("pendulum.urdf").write_text(PENDULUM.replace('effort="5"', f'effort="{1e3 if limit > 9 else 0.9 * limit}"'))
    assert main(["export", "a.json", "--to", "mjcf", "-o", "robot.xml"]) == 0
    model = mujoco.MjModel.from_xml_path("robot.xml")
    (words,) = re.findall(r"commanded velocity and torque of joint1: (ctrl = .*)", capsys.readouterr().err)
    assert words.encode() in bytes(model.text_data)
    found = re.fullmatch(r"ctrl = position \+ (\S+) s \* velocity \+ (\S+) rad/\(N m\) \* torque", words)
    assert found is not None
    shares = [float(share) for share in found.groups()]
    assert shares == pytest.approx([0.6 / kp, 1.0 / kp], rel=1e-5)
    time, each = motions()
    robot: Robot = read_robot("pendulum.urdf")
    command, torque = each["chirp"][0], 1.2 * np.sin(2.0 * np.pi * 0.7 * time)
    velocity = np.gradient(command, time)
    log = replace(
        virtual_logs(robot, true, gains=(kp,))[0],
        time=time,
        q_ref=command[:, None],
        dq_ref=velocity[:, None],
        added=torque[:, None],
    )
    record = record_of(log, 0, measured_loads(robot, log)[0], law)
    ours = rolled_out(record, true)
    assert (ours.saturated.mean() > 0.05) == (limit < 9.0)
    for given, is_near in ((shares, True), ([0.0, shares[1]], False), ([shares[0], 0.0], False)):
        commands = command + given[0] * velocity + given[1] * torque
        q = actuator_proof.driven(mujoco, model, commands[:, None], np.array([0]), np.array([0]), time)[:, 0]
        error = float(np.mean(np.abs(q - rolled_out(replace(record, start=np.array([q[0], 0.0])), true).q)))
        assert error < actuator_proof.TOLERANCE if is_near else error > 0.02, (given, error)


ARM = """<robot name="arm"><link name="base"/>
<link name="a"><inertial><origin xyz="0.02 0 0.03"/><mass value="0.2"/>
<inertia ixx="2e-4" ixy="0" ixz="0" iyy="2e-4" iyz="0" izz="2e-4"/></inertial></link>
<link name="b"><inertial><origin xyz="0.08 0 0"/><mass value="0.15"/>
<inertia ixx="4e-5" ixy="0" ixz="0" iyy="2e-4" iyz="0" izz="2e-4"/></inertial></link>
<link name="c"><inertial><origin xyz="0.07 0.01 0"/><mass value="0.12"/>
<inertia ixx="4e-5" ixy="0" ixz="0" iyy="2e-4" iyz="0" izz="2e-4"/></inertial></link>
<joint name="pan" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-1.9" upper="1.9" effort="3" velocity="5"/></joint>
<joint name="lift" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.03 0 0.05"/><axis xyz="0 1 0"/>
<limit lower="-1.7" upper="1.2" effort="3" velocity="5"/></joint>
<joint name="elbow" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0.12 0 0"/><axis xyz="0 1 0"/>
<limit lower="-1.2" upper="1.6" effort="3" velocity="5"/></joint></robot>"""


@pytest.fixture
def arm(folder: Path) -> dict[str, dict[str, float]]:
    """An arm of three joints with servos of different size as an answer, and their true values."""
    Path("arm.urdf").write_text(ARM)
    true = {
        "pan": {"full_torque": 3.0, "armature": 0.03, "delay": 0.012},
        "lift": {"full_torque": 2.8, "armature": 0.028, "back_emf": 0.5},
        "elbow": {"full_torque": 1.5, "armature": 0.01, "coulomb": 0.06},
    }
    joints = []
    for name, changed in true.items():
        values = parameters(angle_offset=0.0, **changed)
        empty: dict[str, float] = {}
        own = (preset("feetech_sts3215"), (16.0,), "m1", values, (), (), values, values)
        joints.append(JointActuator(name, *own, empty, empty, empty, empty, 0.0))
    write_actuators(ActuatorEstimate("arm", tuple(joints), {"robot": {"path": "arm.urdf"}}), "arm.json")
    return true


def test_an_exported_arm_is_held_against_the_roll_out(
    arm: dict[str, dict[str, float]], capsys: pytest.CaptureFixture[str]
) -> None:
    """MuJoCo's whole arm, joint by joint, is within 1 mrad; a model that is not is named with its joint."""
    words = ["export", "arm.json", "--to", "mjcf", "-o", "arm.xml"]
    assert main([*words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["mujoco_difference_rad"]
    assert found.keys() == arm.keys() and all(value < 1e-3 for value in found.values()), found
    saved = json.loads(Path("arm.json").read_text())
    saved["joints"]["elbow"]["coulomb_viscous"]["load_motor"] = 0.3  # friction that MuJoCo does not have
    Path("arm.json").write_text(json.dumps(saved))
    assert main(words) == 0
    assert "warning: MuJoCo and the roll-out differ by" in (answer := capsys.readouterr().out) and "(elbow;" in answer
    Path("arm.urdf").write_text(ARM.replace('<joint name="elbow"', '<joint name="wrist"'))
    saved["joints"].pop("elbow")
    Path("arm.json").write_text(json.dumps(saved))
    assert main(words) == 0
    assert "joints that were not identified" in capsys.readouterr().out
    assert main([*words, "--no-proof"]) == 0
    assert capsys.readouterr().out == ""


def test_the_proof_keeps_the_limits_of_the_joints(
    arm: dict[str, dict[str, float]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Steps of a joint with little damping overshoot far beyond its limits at full size, where it can hardly hold."""
    saved = json.loads(Path("arm.json").read_text())
    saved["joints"]["lift"]["coulomb_viscous"] |= {"back_emf": 0.02, "viscous": 0.01, "full_torque": 0.8}
    Path("arm.json").write_text(json.dumps(saved))
    driven, ranges = actuator_proof.driven, list[tuple[float, float]]()

    def kept(engine: Any, model: Any, commands: Array, *others: Array) -> Array:
        q = driven(engine, model, commands, *others)
        ranges.append((q[:, 1].min(), q[:, 1].max()) if np.ptp(commands[:, 1]) else (0.0, 0.0))
        return q

    monkeypatch.setattr(actuator_proof, "driven", kept)
    found = actuator_proof.mujoco_differences(read_actuators("arm.json"), 16.0)
    assert all(value < 1e-3 for value in found.values()), found
    moved = [each for each in ranges if any(each)]
    within = [-1.7 <= low and high <= 1.2 for low, high in moved]
    assert len(within) > 1 and within == [False] * (len(within) - 1) + [True]


def known(**labels: str) -> tuple[Known, ...]:
    """Return how far parameters are known: by labels, each with the parameter that it is known with after a comma."""
    parts = {name: text.partition(", ") for name, text in labels.items()}
    return tuple(Known(name, 1.0, np.inf, label, together) for name, (label, _, together) in parts.items())


def test_a_torque_that_no_log_tells_is_no_limit(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Gain and torque at full duty known together: the effort limit of the robot model holds, of 2 N m here.

    A torque that is known takes its place, and of a joint without scale it is said that its numbers are ratios.
    """
    Path("pendulum.urdf").write_text(PENDULUM.replace('effort="5"', 'effort="2"'))
    unit = parameters(angle_offset=0.0, full_torque=2.4 * 0.166 * KP)
    told = {}
    for name, law, values, own in (
        ("known", preset("feetech_sts3215"), parameters(angle_offset=0.0), known(full_torque="identified")),
        ("unknown", preset("position_servo"), unit, known(full_torque="not separable, gain_ratio")),
        (
            "mit",
            replace(preset("mit"), damping_gain=0.05),
            parameters(full_torque=0.9),
            known(full_torque="identified"),
        ),
        (
            "ratio",
            replace(preset("feetech_sts3215"), dead_zone=1e-5),
            parameters(angle_offset=0.0),
            known(full_torque="not separable", armature="known as a ratio", delay="identified"),
        ),
    ):
        kp = (1.0,) if name == "unknown" else (KP,)
        joint = JointActuator("joint1", law, kp, "m1", values, own, (), values, values, {}, {}, {}, {}, 0.0)
        write_actuators(ActuatorEstimate("pendulum", (joint,), {"robot": {"path": "pendulum.urdf"}}), f"{name}.json")
        for target in ("mjcf", "isaac", "urdf"):
            assert main(["export", f"{name}.json", "--to", target, "-o", f"{name}.{target}"]) == 0
            told[name, target] = "".join(capsys.readouterr())
        assert "MuJoCo and the roll-out differ by" in told[name, "mjcf"]
        assert "warning" not in told[name, "mjcf"]
    limits = {
        name: (
            read_robot(f"{name}.mjcf").active[0].limits.effort,
            json.loads(Path(f"{name}.isaac").read_text())["joint1"]["effort_limit_sim"],
            read_robot(f"{name}.urdf").active[0].limits.effort,
        )
        for name in ("known", "unknown", "mit")
    }
    np.testing.assert_allclose(limits["known"], 3 * [2.4 * 0.97], rtol=1e-5)
    assert limits["unknown"] == limits["mit"] == (2.0, None, 2.0)
    assert "joint1 is not known: none is written" in told["unknown", "isaac"]
    assert "the effort limit of the robot model holds" in told["unknown", "mjcf"]
    assert "dead zone and punch of joint1 are no part" in told["ratio", "isaac"] and "punch" not in told["mit", "isaac"]
    assert "known as ratios" in told["ratio", "urdf"] and "known" not in told["known", "isaac"].replace("known.", "")


@pytest.mark.parametrize("effort", [0.5, 5.0], ids=["too low", "right"])
def test_no_limit_is_below_what_the_drive_gave_in_the_logs(
    folder: Path, capsys: pytest.CaptureFixture[str], effort: float
) -> None:
    """A robot model whose effort limit the logs contradict: their largest torque is written, and it is told.

    A file without that torque, of an older version, has the limit of the robot model: the log shows that it is too low.
    """
    Path("pendulum.urdf").write_text(PENDULUM.replace('effort="5"', f'effort="{effort}"'))
    true = parameters(full_torque=2.4 * 0.166 * KP)
    write_csv(
        virtual_logs(read_robot("pendulum.urdf"), parameters(full_torque=12.0), gains=(0.2 * KP,))[0], Path("a.csv")
    )
    keys = "case: 2\nrobot: pendulum.urdf\nservo: {law: position_servo, kp: unknown, friction: m1}\n"
    columns = "log: {columns: {time: t, q: [q1], q_ref: [q_ref1], torque: none}}\ntrain: a.csv\n"
    Path("case.yaml").write_text(keys + columns)
    own = known(full_torque="not separable, gain_ratio")
    law, empty = preset("position_servo"), {}
    for name, most in (("new", 1.9), ("old", np.nan)):
        joint = JointActuator(
            "joint1", law, (1.0,), "m1", true, own, (), true, true, *[empty] * 4, 0.0, (), False, most
        )
        provenance = {"robot": robot_facts("pendulum.urdf"), "case": {"path": "case.yaml"}}
        write_actuators(ActuatorEstimate("pendulum", (joint,), provenance), f"{name}.json")
        told = {}
        for target in ("mjcf", "urdf"):
            assert main(["export", f"{name}.json", "--to", target, "-o", f"{name}.{target}"]) == 0
            told[target] = "".join(capsys.readouterr())
            limit = read_robot(f"{name}.{target}").active[0].limits.effort
            assert limit == (max(effort, 1.9) if name == "new" else effort)
            assert ("the largest torque of the logs is written" in told[target]) == (limit > effort)
        assert ("warning" in told["mjcf"]) == (limit < 1.0) and "mean over a.csv" in told["mjcf"]
    Path("a.csv").unlink()
    assert main(["export", "new.json", "--to", "mjcf", "-o", "new.mjcf"]) == 0
    assert "not followed along a log" in capsys.readouterr().err


def test_tables_hold_the_numbers(arm: dict[str, dict[str, float]]) -> None:
    """Every number of every joint in each table is that of the estimate; MuJoCo reads those of the URDF."""
    for target, name in (("isaac", "a.json5"), ("genesis", "a.yaml"), ("urdf", "b.urdf"), ("c_header", "a.h")):
        assert main(["export", "arm.json", "--to", target, "-o", name, "--quiet"]) == 0
    isaac, genesis = json.loads(Path("a.json5").read_text()), yaml.safe_load(Path("a.yaml").read_text())
    urdf, limits = mujoco.MjModel.from_xml_path("b.urdf"), read_robot("b.urdf").active
    for k, (joint, changed) in enumerate(arm.items()):
        true = {one.name: value for one, value in zip(PARAMETERS, parameters(angle_offset=0.0, **changed), strict=True)}
        stiffness, most = true["full_torque"] * 0.166 * 16.0, true["full_torque"] * 0.97
        damping, friction, delay = true["back_emf"] + true["viscous"], true["coulomb"], true["delay"]
        armature = true["armature"]
        assert isaac[joint] == pytest.approx(
            {"stiffness": stiffness, "damping": 0.0, "effort_limit_sim": most, "armature": armature}
            | {"friction": friction, "viscous_friction": damping, "delay_s": delay}
            | {"goal_slew_limit": None, "angle_offset": 0.0}
        )
        own = genesis[joint]
        assert own.pop("force_range") == pytest.approx([-most, most])
        assert own == pytest.approx(
            {"kp": stiffness, "kv": 0.0, "armature": armature, "frictionloss": friction, "damping": damping}
            | {"delay_s": delay, "goal_slew_limit": None, "angle_offset": 0.0}
        )
        assert urdf.dof_damping[k] == pytest.approx(damping) and urdf.dof_frictionloss[k] == pytest.approx(friction)
        assert limits[k].limits.effort == pytest.approx(most)
        numbers = re.search(rf'{{"{joint}", (.*)}}', Path("a.h").read_text())
        assert numbers is not None
        assert [float(text.replace("INFINITY", "inf")) for text in numbers[1].split(",")] == pytest.approx(
            [stiffness, damping, true["viscous"], friction, armature, most, 0.0, delay, np.inf, 0.0]
        )


ROLL_OUT = r"""#include "a.h"
#include <stdio.h>
#include <stdlib.h>
int main(int count, char **words)
{
    const ServoActuator *a = &servo_actuators[0];
    double inertia = atof(words[1]), weight = atof(words[2]), h = 5e-5, now = 0, q, v = 0, goal;
    static double time[5000], command[5000], on[5000];
    FILE *in = fopen("commands.txt", "r"), *out = fopen("positions.txt", "w");
    int n = 0, late = 0, k;
    while (fscanf(in, "%lf %lf %lf", &time[n], &command[n], &on[n]) == 3) n++;
    q = goal = command[0];
    for (k = 0; k < n; k++) {
        for (; now < time[k] - 0.5 * h; now += h) {
            while (late + 1 < n && time[late + 1] + a->delay_s <= now + 1e-9) late++;
            goal = servo_goal(a, goal, command[late], h);
            double free = on[k - 1] > 0.5 ? servo_torque(a, goal, 0, q, v) : 0;
            free -= weight * sin(q + a->angle_offset) + a->viscous * v;
            double mass = inertia + a->armature, stop = servo_friction(a, 1) - a->viscous;
            double next = v + h * free / mass, most = h * stop / mass;
            v = fabs(next) > most ? next - copysign(most, next) : 0;
            q += h * v;
        }
        fprintf(out, "%.9f\n", q);
    }
    return count != 3 || fclose(out);
}
"""


@pytest.mark.parametrize(
    "changed", [{}, {"slew_limit": 2.5, "angle_offset": 0.1}], ids=["plain", "slew limit and zero"]
)
def test_compiled_c_follows_the_roll_out(folder: Path, robot: Robot, changed: dict[str, float]) -> None:
    """Within 0.3 mrad on average over chirp, steps with saturation and a release: the header has the whole law."""
    compiler = find_compiler()
    if compiler is None:
        pytest.skip("no C compiler (cc, gcc or clang) on this machine")
    true, law = parameters(**changed), preset("feetech_sts3215")
    joint = JointActuator("joint1", law, (KP,), "m1", true, (), (), true, true, {}, {}, {}, {}, 0.0)
    write_actuators(ActuatorEstimate("pendulum", (joint,), {"robot": {"path": "pendulum.urdf"}}), "a.json")
    assert main(["export", "a.json", "--to", "c_header", "-o", "a.h", "--quiet"]) == 0
    Path("roll_out.c").write_text(ROLL_OUT)
    program = build_program(compiler, folder, Path("roll_out.c"), "roll_out")
    for name, (command, on) in motions()[1].items():
        log = virtual_log(ServoBench(robot, law, resolution=0.0), true, motions()[0], command, KP, on > 0.5)
        np.savetxt("commands.txt", np.column_stack([log.time, command, on]))
        (load,) = measured_loads(robot, log)
        run_program([str(program), f"{load.inertia[0]:.17g}", f"{load.bias[0, 2]:.17g}"], folder)
        away = np.mean(np.abs(np.loadtxt("positions.txt") - log.q[:, 0]))
        assert away < 3e-4, (name, away)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--to", "mjcf"], "the logs have kp 4, 6; say which"),
        (["--to", "gazebo", "--option", "kp=4"], "no target for actuators called 'gazebo'"),
        (["--to", "isaac", "--option", "kv=4"], "kv"),
        (["--to", "isaac", "--option", "kp=4", "--speed", "20"], "holds actuators"),
    ],
)
def test_what_cannot_be_written_is_said(
    folder: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    assert main(["export", "a.json", "-o", "out", *words]) == 1
    assert said in capsys.readouterr().err and not Path("out").exists()


def test_the_armature_and_the_actuators_of_a_model_are_replaced(folder: Path) -> None:
    """A model that states an armature has no part of it left: neither in the load of the fit nor beside the export."""
    body = '<geom size="0.02" pos="0 0 -0.15" mass="0.8"/>'
    joint = '<joint name="joint1" axis="0 1 0" range="-180 180" armature="0.5" damping="3" frictionloss="1"/>'
    actuator = '<actuator><position name="joint1" joint="joint1" kp="50"/></actuator>'
    Path("pendulum.xml").write_text(
        f'<mujoco><worldbody><body name="arm">{joint}{body}</body></worldbody>{actuator}</mujoco>'
    )
    robot = read_robot("pendulum.xml")
    (log,) = virtual_logs(robot, parameters(), gains=(KP,))[:1]
    (load,) = measured_loads(robot, log)
    assert np.allclose(load.inertia, 0.8 * 0.15**2 + 0.4 * 0.8 * 0.02**2)
    saved = json.loads(Path("a.json").read_text())
    saved["provenance"]["robot"]["path"] = "pendulum.xml"
    Path("a.json").write_text(json.dumps(saved))
    assert main(["export", "a.json", "--to", "mjcf", "-o", "robot.xml", "--option", "kp=4", "--quiet"]) == 0
    model = mujoco.MjModel.from_xml_path("robot.xml")
    assert model.nu == 1 and model.actuator_gainprm[0, 0] == pytest.approx(2.4 * 0.166 * 4)
    assert model.dof_armature[0] == pytest.approx(0.012) and model.dof_frictionloss[0] == pytest.approx(0.04)


def test_the_limit_of_an_actuator_in_the_model_holds_where_no_log_tells_the_torque(folder: Path) -> None:
    """The identified actuators take the place of those of an MJCF, which state its effort limits."""
    Path("arm.xml").write_text(
        """<mujoco><compiler angle="radian"/><worldbody><body name="arm"><joint name="joint1" axis="0 1 0"/>
        <inertial pos="0 0 -0.15" mass="0.8" diaginertia="0.002 0.002 0.001"/></body></worldbody>
        <actuator><position joint="joint1" kp="3" forcerange="-2 2"/></actuator></mujoco>"""
    )
    values = parameters(angle_offset=0.0, full_torque=2.4 * 0.166 * KP)
    own = known(full_torque="not separable, gain_ratio")
    law = preset("position_servo")
    joint = JointActuator("joint1", law, (1.0,), "m1", values, own, (), values, values, {}, {}, {}, {}, 0.0)
    write_actuators(ActuatorEstimate("pendulum", (joint,), {"robot": {"path": "arm.xml"}}), "own.json")
    assert main(["export", "own.json", "--to", "mjcf", "-o", "own.xml", "--quiet"]) == 0
    assert read_robot("own.xml").active[0].limits.effort == 2.0


def test_friction_that_a_target_has_not_is_told_with_what_it_costs(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = read_actuators("a.json")
    words = ["--to", "mjcf", "--no-proof", "-o", "robot.xml", "--option", "kp=4"]
    assert main(["export", "a.json", *words]) == 0
    assert "in the place of" not in capsys.readouterr().err
    for folds, told in (({}, "joint1 m4"), ({"m1": 4.3e-3, "m4": 4e-4}, "joint1 m4 (held out 4.3 mrad for 0.4)")):
        joint = replace(found.joints[0], friction="m4", folds=folds)
        write_actuators(replace(found, joints=(joint,)), "b.json")
        assert main(["export", "b.json", *words]) == 0
        assert f"Coulomb and viscous friction alone, in the place of {told}" in capsys.readouterr().err


def test_an_export_does_not_write_over_the_robot_model(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = Path("pendulum.urdf").read_bytes()
    assert main(["export", "a.json", "--to", "urdf", "--no-proof", "-o", "pendulum.urdf", "--option", "kp=4"]) == 1
    assert "would be overwritten" in capsys.readouterr().err and Path("pendulum.urdf").read_bytes() == before
