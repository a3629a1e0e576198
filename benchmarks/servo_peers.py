"""Servos beside mujoco.sysid and CMA-ES, on the same logs in one process: error of held-out roll-outs and time.

The XL330 logs whose drive is on throughout: those of one kp (by default 200, split A of its README) to test, those of
the three others to learn from. mujoco.sysid as its documentation shows: MuJoCo at 2 ms (implicitfast), its own least
squares by finite differences, errors over the size of the measured motion of each log, a position actuator with a force
range, and as parameters the torque at full duty, damping, armature, frictionloss and the tilt of the base (an angle
offset). CMA-ES (package cma) over the roll-outs of dynident with load-dependent friction,
Huber-like cost as in the fit, population and step by its defaults, in the logarithms of the parameters, until its own
tolerances or a budget of the processor. All three know the drive law, CMA-ES and mujoco.sysid start from the same
guess, and BLAS has one thread. Needs: pip install "mujoco[sysid]" cma.
Run: python -m benchmarks.servo_peers FOLDER [--held KP ...] [--budget SECONDS]
"""

from __future__ import annotations

import argparse
import logging
import time
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from dynident.actuators.drive_law import preset
from dynident.actuators.identify import identify_actuators
from dynident.actuators.joint_load import measured_loads
from dynident.actuators.parameters import PLACE, neutral
from dynident.actuators.rollout import JointRecord, mean_errors, record_of, rolled_out
from dynident.actuators.servo_files import read_servo_logs
from dynident.actuators.servo_log import ServoColumns, ServoLog, ServoSetup
from dynident.arrays import Array
from dynident.data.formats import ColumnMap
from dynident.model.threads import one_blas_thread
from dynident.robot_files import read_robot

LAW = preset("dynamixel_xl330")

#: Point mass and length of the pendulum, by the README of the logs.
MASS, LENGTH = 0.49, 0.1

#: Guess of the parameters that the searches start from: what a data sheet of the servo says, to a factor of two.
GUESS = {"full_torque": 0.5, "viscous": 0.05, "coulomb": 0.02, "load_motor": 0.05, "armature": 0.003, "delay": 0.004}

PENDULUM = f"""<mujoco><option integrator="implicitfast" timestep="0.002"><flag contact="disable"/></option><worldbody>
<body name="arm"><inertial pos="0 0 {-LENGTH}" mass="{MASS}" diaginertia="1e-9 1e-9 1e-9"/>
<joint name="joint1" type="hinge" axis="0 1 0" armature="0.003"/></body></worldbody>
<actuator><position name="servo" joint="joint1" kp="1" forcerange="-1 1"/></actuator>
<sensor><jointpos name="position" joint="joint1"/></sensor></mujoco>"""


def by_dynident(robot: Any, train: Sequence[ServoLog], test: Sequence[ServoLog], friction: str) -> str:
    """Return the line of dynident: linear start, output error, intervals."""
    begun = time.process_time()
    setup = ServoSetup((LAW,), ServoColumns(("joint1",)), friction)
    joint = identify_actuators(robot, setup, train, test).joints[0]
    seconds = time.process_time() - begun
    return line(f"dynident, friction {friction}", joint.mean_error(joint.train), joint.mean_error(joint.test), seconds)


def by_cma(train: Sequence[JointRecord], test: Sequence[JointRecord], budget: float) -> str:
    """Return the line of CMA-ES over the same roll-outs."""
    import cma  # pyright: ignore[reportMissingImports]

    names = (*GUESS, "angle_offset")

    def parameters(values: Array) -> Array:
        found = neutral()
        for name, value in zip(names, values, strict=True):
            found[PLACE[name]] = 0.1 * value if name == "angle_offset" else GUESS[name] * np.exp(value)
        found[PLACE["load_external"]] = found[PLACE["load_motor"]]
        return found

    def cost(values: Array) -> float:
        errors = np.concatenate([rolled_out(r, parameters(values), longest=2e-3).q - r.q for r in train])
        return float(np.mean(np.sqrt(1.0 + np.minimum(np.nan_to_num(errors, nan=10.0) ** 2, 100.0) / 0.03**2)))

    begun = time.process_time()
    search = cma.CMAEvolutionStrategy(np.zeros(len(names)), 0.3, {"verbose": -9, "seed": 1})
    while not search.stop() and time.process_time() - begun < budget:
        points = search.ask()
        search.tell(points, [cost(point) for point in points])
    found = parameters(search.result.xbest)
    seconds = time.process_time() - begun
    name = f"CMA-ES, load-dependent, {search.result.evaluations} evaluations"
    return line(name, float(mean_errors(train, found).mean()), float(mean_errors(test, found).mean()), seconds)


def by_sysid(train: Sequence[ServoLog], test: Sequence[ServoLog]) -> str:
    """Return the line of mujoco.sysid."""
    mujoco: Any = import_module("mujoco")
    sysid: Any = import_module("mujoco.sysid")
    if not hasattr(sysid, "optimize"):
        raise SystemExit('mujoco.sysid lacks its own packages: pip install "mujoco[sysid]"')
    logging.disable(logging.WARNING)

    def full_torque(spec: Any, parameter: Any) -> None:
        servo = spec.actuators[0]
        torque, gain = float(parameter.value[0]), float(servo.name.removeprefix("servo"))
        servo.gainprm[0], servo.biasprm[1] = torque * gain, -torque * gain
        servo.forcerange[:] = -torque * LAW.limit, torque * LAW.limit

    def of_joint(name: str) -> Any:
        def modify(spec: Any, parameter: Any) -> None:
            value = getattr(spec.joint("joint1"), name)
            if np.ndim(value):
                value[0] = float(parameter.value[0])
            else:
                setattr(spec.joint("joint1"), name, float(parameter.value[0]))

        return modify

    def tilt(spec: Any, parameter: Any) -> None:
        angle = float(parameter.value[0])
        spec.option.gravity[:] = 9.81 * np.sin(-angle), 0.0, -9.81 * np.cos(angle)

    groups = []
    for kp in sorted({log.kp for log in train}):
        spec = mujoco.MjSpec.from_string(PENDULUM)
        spec.actuators[0].name = f"servo{kp * LAW.error_gain:.12g}"
        own = [log for log in train if log.kp == kp]
        groups.append(
            sysid.ModelSequences(f"kp{kp:g}", spec, [log.name for log in own], *_signals(sysid, spec.compile(), own))
        )
    start = sysid.ParameterDict()
    for name, modify, value, low, high in (
        ("full_torque", full_torque, GUESS["full_torque"], 0.05, 3.0),
        ("damping", of_joint("damping"), GUESS["viscous"], 0.0, 0.5),
        ("armature", of_joint("armature"), GUESS["armature"], 1e-5, 0.05),
        ("frictionloss", of_joint("frictionloss"), GUESS["coulomb"], 0.0, 0.3),
        ("tilt", tilt, 0.0, -0.2, 0.2),
    ):
        start.add(sysid.Parameter(name, value, min_value=low, max_value=high, modifier=modify))
    begun = time.process_time()
    found, _ = sysid.optimize(start, sysid.build_residual_fn(models_sequences=groups, n_threads=1), verbose=False)
    seconds = time.process_time() - begun
    errors = [[_error(mujoco, sysid, found, log) for log in logs] for logs in (train, test)]
    return line("mujoco.sysid, Coulomb and viscous", float(np.mean(errors[0])), float(np.mean(errors[1])), seconds)


def _signals(sysid: Any, model: Any, logs: Sequence[ServoLog]) -> tuple[list, list, list]:
    states, controls, sensors = [], [], []
    for log in logs:
        grid = np.arange(log.time[0], log.time[-1], model.opt.timestep) - log.time[0]
        held = np.searchsorted(log.time - log.time[0], grid, side="right") - 1
        states.append(sysid.create_initial_state(model, log.q[0], np.zeros(1), np.zeros(0)))
        controls.append(sysid.TimeSeries(grid, log.q_ref[held]))
        seen = np.interp(grid, log.time - log.time[0], log.q[:, 0])[:, None]
        sensors.append(sysid.TimeSeries.from_names(grid, seen, model))
    return states, controls, sensors


def _error(mujoco: Any, sysid: Any, found: Any, log: ServoLog) -> float:
    """Return the mean absolute error in rad of the roll-out of a log."""
    spec = mujoco.MjSpec.from_string(PENDULUM)
    spec.actuators[0].name = f"servo{log.kp * LAW.error_gain:.12g}"
    model = sysid.apply_param_modifiers(found, spec)
    data, stamps = mujoco.MjData(model), log.time - log.time[0]
    data.qpos[:] = log.q[0]
    grid = np.arange(0.0, stamps[-1], model.opt.timestep)
    path = []
    for row in np.searchsorted(stamps, grid, side="right") - 1:
        path.append(data.qpos[0])
        data.ctrl[:] = log.q_ref[row]
        mujoco.mj_step(model, data)
    return float(np.mean(np.abs(np.interp(stamps, grid, path) - log.q[:, 0])))


def line(name: str, train: float, test: float, seconds: float) -> str:
    """Return a row of the table."""
    return f"{name:45s} {1e3 * train:8.1f} {1e3 * test:8.1f} {seconds:10.1f}"


@one_blas_thread()
def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("folder", type=Path, help="the folder dynamixel_xl330_bam")
    options.add_argument("--budget", type=float, default=300.0, help="seconds of the processor for CMA-ES")
    options.add_argument("--held", type=float, nargs="+", default=[200.0], help="position gains to test, one by one")
    chosen = options.parse_args()
    robot = read_robot(str(chosen.folder / "urdf" / "pendulum_m0490_l100.urdf"))
    columns = ColumnMap(time="t", q=("q1",), q_ref=("q_ref1",), torque=())
    how = ServoColumns((robot.joint_names[0],), columns, ("torque_enable",), kp="kp{}")
    names = sorted(path for path in (chosen.folder / "logs").glob("*.csv") if "drop" not in path.name)
    logs = [log for path in names for log in read_servo_logs(path, how)]
    by_dynident(robot, logs[:1], [], "m1")  # compiled code and packages are loaded
    for kp in chosen.held:
        train, test = [log for log in logs if log.kp != kp], [log for log in logs if log.kp == kp]
        print(f"kp {kp:g}: {len(train)} logs to learn from, {len(test)} to test")
        print(f"{'':45s} {'training':>8s} {'test':>8s} {'processor':>10s}")
        print(f"{'':45s} {'mrad':>8s} {'mrad':>8s} {'s':>10s}")
        for friction in ("m1", "m3", "auto"):
            print(by_dynident(robot, train, test, friction), flush=True)
        print(by_sysid(train, test), flush=True)
        seen, unseen = (
            [record_of(log, 0, measured_loads(robot, log)[0], LAW) for log in some] for some in (train, test)
        )
        print(by_cma(seen, unseen, chosen.budget), flush=True)


if __name__ == "__main__":
    main()
