"""Draw the pictures of the how-to pages from what the commands on them write.

All are of the four-axis arm generic-scara on a motion of its own design, with logs simulated from a known truth. Needs
matplotlib, and chromium for the screens of report and studio; about a minute of a processor.

  python scripts/page_pictures.py             # all
  python scripts/page_pictures.py monitor fleet
"""

from __future__ import annotations

import contextlib
import io
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import dynident as di
from dynident.api.applications import monitor as monitor_logs
from dynident.api.servo_motions import servo_motions
from dynident.applications.drive_gains import gains_from_prior
from dynident.cli.main import main as dynident
from dynident.exports.motions import DrivenMotion

ROOT = Path(__file__).resolve().parent.parent
FIGURES = ROOT / "docs" / "figures"
ROBOT = "generic-scara"
PARTS = ["coulomb", "viscous"]
TRUE_FRICTION = [2.0, 3.0, 1.5, 2.0, 8.0, 30.0, 0.2, 0.1]
NOISE = di.Noise(position=2e-6, torque=[1.0, 0.5, 2.0, 0.05])
SIZE = (7.0, 2.6)
QUICK = di.TrustOptions()


class Study:
    """The arm, its plan, logs of it and its estimate, each made when it is first asked for, in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.robot = di.read_robot(ROBOT)
        self.model = di.DynamicModel(self.robot, PARTS)
        nominal = self.model.nominal()
        assert nominal is not None
        self.theta = np.append(nominal[: self.model.inertial_count], TRUE_FRICTION)

    def command(self, *words: str) -> str:
        """Run a command in the folder and return what it prints."""
        shown = io.StringIO()
        with contextlib.redirect_stdout(shown), contextlib.chdir(self.folder):
            dynident(list(words))
        return shown.getvalue()

    @cached_property
    def plan(self) -> Any:
        """A motion of eight seconds."""
        return self.plan_of(ROBOT, "plan.json")

    def plan_of(self, robot: str, file: str, period: str = "8") -> Any:
        """Return a motion of eight seconds, or another period, of a robot, written into a file."""
        if not (self.folder / file).exists():
            self.command("excite", robot, "-o", file, "--period", period, "--starts", "1", "--quiet")
        return di.read_plan(self.folder / file)

    @cached_property
    def preprocessing(self) -> di.Preprocessing:
        """The default with an estimated delay: the virtual controller holds a torque for a sample."""
        return replace(di.read_case(ROBOT).preprocessing, delay_s=None)

    @cached_property
    def viscous(self) -> tuple[di.DynamicModel, Any]:
        """The arm with viscous friction alone, and its parameters."""
        model = di.DynamicModel(self.robot, ["viscous"])
        return model, np.append(self.theta[: model.inertial_count], TRUE_FRICTION[1::2])

    def log(self, seed: int, theta: Any = None, seconds: float = 16.0, model: di.DynamicModel | None = None) -> di.Log:
        """Return a log with positions and torques alone."""
        timing = di.Timing(duration=seconds, rate=250.0)
        true = self.theta if theta is None else theta
        run = di.simulate(model or self.model, true, self.plan.trajectory, timing=timing, noise=NOISE, seed=seed).log
        return di.Log(self.robot.joint_names, run.time, run.q, torque=run.torque)

    def loaded(self, mass: float) -> Any:
        """Return the parameters with a load on the last link."""
        theta = self.theta.copy()
        body = di.Inertia.from_centre_of_mass(mass, [0.0, 0.0, 0.05], 0.003 * np.eye(3))
        theta[30:40] += body.vector
        return theta

    @cached_property
    def estimate(self) -> di.Estimate:
        """The estimate of one log, in estimate.json too."""
        di.write_log(self.log(0), self.folder / "run.csv")
        words = ("identify", ROBOT, "run.csv", "--friction", *PARTS, "-o", "estimate.json", "--quiet")
        self.command(*words)
        return di.read_estimate(self.folder / "estimate.json")


def _axes(rows: int = 1, height: float = SIZE[1], **options: Any) -> tuple[Figure, Any]:
    figure = Figure(figsize=(SIZE[0], height), layout="constrained")
    return figure, figure.subplots(rows, 1, sharex=True, **options)


def _torque(log: di.Log) -> np.ndarray:
    assert log.torque is not None
    return log.torque


def _legend(axis: Any, columns: int = 4) -> None:
    place = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "frameon": False}
    axis.legend(fontsize="small", ncols=columns, **place)


def motion(study: Study) -> Figure:
    """Positions and speeds of the designed motion as shares of the limits."""
    time = np.linspace(0.0, 8.0, 801)
    q, dq, _ = study.plan.trajectory.evaluate(time)
    figure, (above, below) = _axes(2, 3.4)
    for k, joint in enumerate(study.robot.joints):
        middle, half = (joint.limits.upper + joint.limits.lower) / 2, (joint.limits.upper - joint.limits.lower) / 2
        above.plot(time, 100 * (q[:, k] - middle) / half, label=joint.name)
        below.plot(time, 100 * dq[:, k] / joint.limits.velocity)
    for axis, what in ((above, "position"), (below, "velocity")):
        axis.set_ylabel(f"{what}\n[% of limit]")
        axis.axhline(100, color="0.5", dashes=(4, 3))
        axis.axhline(-100, color="0.5", dashes=(4, 3))
    below.set_xlabel("time [s]")
    _legend(above)
    return figure


def limits(study: Study) -> Figure:
    """Torque of the designed motion at the joints, in shares of the effort limits."""
    time = np.linspace(0.0, 8.0, 801)
    q, dq, ddq = study.plan.trajectory.evaluate(time)
    torque = study.model.torque(q, dq, ddq, study.theta)
    figure, axis = _axes()
    for k, joint in enumerate(study.robot.joints):
        axis.plot(time, 100 * torque[:, k] / joint.limits.effort, label=joint.name)
    for side in (-100, 100):
        axis.axhline(side, color="0.5", dashes=(4, 3))
    axis.set(xlabel="time [s]", ylabel="torque [% of limit]")
    _legend(axis)
    return figure


def printed(study: Study, exporter: str, robot: str = "generic-6r") -> Figure:
    """The points that an exporter prints, read back from its text, on the plan."""
    plan = study.plan_of(robot, f"{robot}.json")
    part = di.MOTION_EXPORTERS.make(exporter)
    driven = DrivenMotion(plan, part.rate, 1, 1.0, None, True)
    points = part.content(driven, study.folder / f"motion{part.suffix}").printed
    time = np.linspace(0.0, 8.0, 801)
    q, _, _ = plan.trajectory.evaluate(time)
    figure, axis = _axes()
    every = max(1, len(points.time) // 120)
    for k, name in enumerate(plan.joints[:2]):
        axis.plot(time, np.rad2deg(q[:, k]), color=f"C{k}", linewidth=0.8, label=f"{name}, plan")
        shown = np.rad2deg(points.signals[0][::every, k])
        axis.plot(points.time[::every], shown, ".", markersize=4, color=f"C{k}", label=f"{name}, in the file")
    shown = "" if every == 1 else f", one in {every} drawn"
    axis.set(xlabel=f"time [s]; {exporter}: {len(points.time)} points{shown}", ylabel="position [°]")
    _legend(axis, 2)
    return figure


def recording(study: Study) -> Figure:
    """A log fit for identification: fast motion of all joints, with torques."""
    log = study.log(0)
    figure, (above, below) = _axes(2, 3.4)
    for k, name in enumerate(study.robot.joint_names[:2]):
        above.plot(log.time, np.rad2deg(log.q[:, k]), label=name)
        below.plot(log.time, _torque(log)[:, k], linewidth=0.7)
    above.set_ylabel("position [°]")
    below.set(ylabel="torque [N·m]", xlabel="time [s]")
    _legend(above)
    return figure


def filtered(study: Study) -> Figure:
    """A torque as it came, at a fitting cut-off and at one that is too low."""
    log = study.log(0)
    figure, axis = _axes()
    axis.plot(log.time, _torque(log)[:, 2], color="0.8", linewidth=0.6, label="as it came")
    for cutoff, colour in ((15.0, "C0"), (1.0, "C3")):
        preprocessing = di.Preprocessing(di.FILTERS.make("butterworth", {"cutoff_hz": cutoff}))
        done = di.preprocess(log, preprocessing).log
        axis.plot(done.time, _torque(done)[:, 2], color=colour, linewidth=1.1, label=f"cut-off {cutoff:g} Hz")
    axis.set(xlim=(2, 6), xlabel="time [s]", ylabel="quill [N]")
    _legend(axis)
    return figure


def outliers(study: Study) -> Figure:
    """Test error by estimator where one sample in fifty of the training log is an outlier."""
    log, test = study.log(0), study.log(1)
    random = np.random.default_rng(0)
    torque = np.array(log.torque)
    torque[random.random(len(torque)) < 0.02] *= 3.0
    bad = di.Log(log.joints, log.time, log.q, torque=torque)
    names = ("ols", "wls", "huber", "irls", "consistent")
    errors = [
        100 * di.validate(di.identify(study.model, bad, name, trust=QUICK), test).total_relative_error for name in names
    ]
    figure, axis = _axes(height=2.2)
    axis.barh(names[::-1], errors[::-1], color="C0", height=0.6)
    axis.set_xlabel("total relative test error [%]")
    return figure


def compared(study: Study) -> Figure:
    """Base parameters by three estimators over the truth, with 95 % intervals."""
    model, theta = study.viscous
    figure, axis = _axes(height=2.8)
    for shift, name in enumerate(("ols", "wls", "consistent")):
        found = di.identify(model, study.log(0, theta, model=model), name, study.preprocessing, trust=QUICK)
        table, truth = found.to_frame(), found.base.from_standard(theta)
        known = np.flatnonzero(np.abs(truth) > 0.05)
        axis.set_xticks(range(len(known)), [_short(found.base.names[k]) for k in known], fontsize="x-small")
        value, half = table["value"].to_numpy(), found.half_widths()
        at = np.arange(len(known)) + 0.2 * (shift - 1)
        axis.errorbar(at, (value / truth)[known], (half / np.abs(truth))[known], fmt="o", markersize=3, label=name)
    axis.axhline(1.0, color="0.5", dashes=(4, 3))
    axis.set_ylabel("estimate / truth")
    _legend(axis)
    return figure


def _short(name: str) -> str:
    return name.split(" ", maxsplit=1)[0].replace("[", "\n[")


def rehearsed(study: Study) -> Figure:
    """How far estimates of six rehearsals are from the truth, in their own standard deviations."""
    model, theta = study.viscous
    away = []
    for seed in range(6):
        found = di.identify(model, study.log(seed, theta, model=model), "wls", study.preprocessing, trust=QUICK)
        away.append((found.beta - found.base.from_standard(theta)) / found.std)
    figure, axis = _axes()
    axis.plot(np.arange(len(away[0])), np.array(away).T, ".", color="C0")
    for side in (-1.96, 1.96):
        axis.axhline(side, color="0.5", dashes=(4, 3))
    axis.set(xlabel="base parameter", ylabel="(estimate - truth) / std")
    return figure


def cell(study: Study) -> Figure:
    """Torque of a virtual cell, as it is and as it is logged."""
    study.plan_of(ROBOT, "short.json", "4")
    study.command("simulate", ROBOT, "short.json", "-o", "cell.csv", "--set", "effort.noise=2", "--quiet")
    log = di.log_of(study.folder / "cell.csv", study.robot)
    truth = np.load(study.folder / "cell.truth.npz")
    figure, axis = _axes()
    axis.plot(log.time, _torque(log)[:, 1], color="0.75", linewidth=0.6, label="in the log")
    axis.plot(truth["t"], truth["tau"][:, 1], color="C0", linewidth=0.9, label="true")
    axis.set(xlim=(0, 4), xlabel="time [s]", ylabel="elbow [N·m]")
    _legend(axis)
    return figure


def gains(study: Study) -> Figure:
    """Drive gains from the currents of six logs at two cut-offs, over the true ones, with 95 % intervals."""
    true = np.array([60.0, 40.0, 900.0, 8.0])
    logs = [study.log(seed) for seed in range(6)]
    currents = [di.Log(log.joints, log.time, log.q, current=_torque(log) / true) for log in logs]
    figure, axis = _axes(height=2.8)
    for side, cutoff in ((0.4, 5.0), (0.0, 30.0)):
        preprocessing = replace(study.preprocessing, filter=di.FILTERS.make("butterworth", cutoff_hz=cutoff))
        for k, one in enumerate(currents):
            found = gains_from_prior(study.model, [one], preprocessing=preprocessing).gains
            ratio, low, high = np.array([(gain.value, gain.low, gain.high) for gain in found]).T / true
            at = np.arange(len(ratio)) + side - 0.06 * k
            style = {"color": "C3" if side else "C0", "markersize": 3, "linewidth": 1}
            label = "" if k else f"cut-off {cutoff:g} Hz"
            axis.errorbar(ratio, at, xerr=(ratio - low, high - ratio), fmt="o", label=label, **style)
    axis.axvline(1.0, color="0.5", dashes=(4, 3))
    axis.set_yticks(range(len(true)), study.robot.joint_names)
    axis.set_xlabel("drive gain found / true")
    _legend(axis)
    return figure


def payload(study: Study) -> Figure:
    """Torque that a load of 1.5 kg adds, and what the payload found explains of it."""
    _ = study.estimate
    log = study.log(3, study.loaded(1.5))
    di.write_log(log, study.folder / "loaded.csv")
    found = json.loads(study.command("payload", "estimate.json", "loaded.csv", "--json"))
    mass = next(one for one in found["parameters"] if one["name"] == "m")
    test = di.validate(study.estimate, log)
    carried = study.loaded(mass["value"]) - study.theta
    with_load = study.model.regressor(test.q, test.dq, np.gradient(test.dq, test.time, axis=0)) @ carried
    figure, axis = _axes()
    axis.plot(test.time, test.residual[:, 2], color="0.6", linewidth=0.8, label="measured less model without load")
    label = f"of the load found, {mass['value']:.3f} ± {mass['half_width']:.3f} kg"
    axis.plot(test.time, with_load[:, 2], color="C3", linewidth=1.0, label=label)
    axis.set(xlabel="time [s]", ylabel="quill [N]")
    _legend(axis, 2)
    return figure


def servos(study: Study) -> Figure:
    """Commands of the elbow of the virtual arm of servos, grey where the drive is off."""
    elbow = servo_motions(ROOT / "examples" / "servo_arm" / "arm.yaml").joints[2]
    figure, axis = _axes()
    begin = 0.0
    for k, one in enumerate(elbow.motions):
        motion = one.motion
        off = np.where(motion.enabled, np.nan, motion.command)
        on = np.where(motion.enabled, motion.command, np.nan)
        axis.plot(motion.time + begin, on, color=f"C{k}", linewidth=0.9, label=motion.kind)
        axis.plot(motion.time + begin, off, color="0.6", linewidth=1.5)
        begin += motion.time[-1]
    axis.set(xlabel="time [s]", ylabel="command [rad]")
    _legend(axis)
    return figure


def monitor(study: Study) -> Figure:
    """Residual of the observer and its threshold, with a contact of 0.2 s."""
    log = study.log(4)
    torque = np.array(log.torque)
    torque[(log.time > 6.0) & (log.time < 6.2), 0] += 12.0
    hit = di.Log(log.joints, log.time, log.q, torque=torque)
    (seen,) = monitor_logs(study.estimate, [hit], clean=[study.log(5), study.log(6)]).logs
    figure, axis = _axes()
    axis.plot(seen.time, seen.residual[:, 0], linewidth=0.8, label="torque from outside, shoulder")
    axis.plot(seen.time, seen.threshold[:, 0], color="0.5", linewidth=0.8, label="threshold")
    axis.plot(seen.time, -seen.threshold[:, 0], color="0.5", linewidth=0.8)
    for alarm in seen.alarms:
        axis.axvline(alarm.start, color="C3", label="alarm")
    axis.set(xlim=(4, 8), xlabel="time [s]", ylabel="[N·m]")
    _legend(axis)
    return figure


def track(study: Study) -> Figure:
    """Mass at the last joint along a log in which a load is taken up."""
    _ = study.estimate
    plain, loaded = study.log(7), study.log(7, study.loaded(1.0))
    torque = np.where(plain.time[:, None] < 8.0, plain.torque, loaded.torque)
    shift = di.Log(plain.joints, plain.time, plain.q, torque=torque)
    di.write_log(shift, study.folder / "shift.csv")
    study.command("track", "estimate.json", "shift.csv", "-o", "course.csv", "--memory", "2", "--quiet")
    course = np.genfromtxt(study.folder / "course.csv", delimiter=",", names=True, deletechars="")
    mass = next(name for name in course.dtype.names if name.startswith("m[slide]"))
    half = next(name for name in course.dtype.names if name.startswith("half_m[slide]"))
    figure, axis = _axes()
    axis.plot(course["t"], course[mass], label="m[slide] + m[flange], followed")
    band = (course[mass] - course[half], course[mass] + course[half])
    axis.fill_between(course["t"], *band, alpha=0.2, label="95 % interval")
    axis.axvline(8.0, color="0.5", dashes=(4, 3), label="load of 1 kg taken up")
    axis.set(xlabel="time [s]", ylabel="[kg]")
    _legend(axis)
    return figure


def fleet(study: Study) -> Figure:
    """Coulomb friction of the elbow of six robots, each alone and as one of the fleet."""
    random = np.random.default_rng(0)
    files = []
    for robot in range(6):
        theta = study.theta.copy()
        theta[study.model.inertial_count :] *= random.normal(1.0, 0.05, 8)
        log = study.log(robot + 20, theta, 4.0)
        di.identify(study.model, log, "wls", trust=QUICK).save(study.folder / f"cell-{robot + 1}.json")
        files.append(f"cell-{robot + 1}.json")
    study.command("fleet", *files, "-o", "fleet", "--quiet")
    figure, axis = _axes()
    for shift, folder, label in ((-0.1, study.folder, "alone"), (0.1, study.folder / "fleet", "in the fleet")):
        tables = [di.read_estimate(folder / file).to_frame().loc["Fc[elbow]"] for file in files]
        value = np.array([table["value"] for table in tables])
        half = np.array([table["upper"] for table in tables]) - value
        axis.errorbar(np.arange(1, 7) + shift, value, half, fmt="o", markersize=4, capsize=3, label=label)
    axis.set(xlabel="robot", ylabel="Fc[elbow] [N·m]")
    _legend(axis)
    return figure


def parameters(study: Study) -> Figure:
    """Base parameters with their 95 % intervals."""
    figure = study.estimate.plot_parameters()
    figure.set_size_inches(9.0, 4.2)
    return figure


def report_screen(study: Study, target: Path) -> None:
    """Take the first screen of a report."""
    _ = study.estimate
    di.write_log(study.log(1), study.folder / "test.csv")
    study.command("report", "estimate.json", "--test", "test.csv", "-o", "report.html", "--quiet")
    _screen((study.folder / "report.html").as_uri(), target)


def studio_screen(study: Study, target: Path) -> None:
    """Take the page of a studio on a folder with a log and its estimate."""
    _ = study.estimate
    folder = study.folder / "scara"
    folder.mkdir()
    for file in ("run.csv", "estimate.json"):
        shutil.copy(study.folder / file, folder)
    command = [sys.executable, "-m", "dynident", "studio", "--work", str(folder), "--no-browser", "--quiet"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            found = re.search(r"http://\S+", server.stdout.readline())
            assert found is not None
            _screen(found[0], target)
        finally:
            server.terminate()


def _screen(address: str, target: Path) -> None:
    """Take a picture of a page of 1200 by 800 with chromium."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        raise SystemExit("the screens need chromium")
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--window-size=1200,800", "--virtual-time-budget=8000"]
    command = [program, *options, f"--screenshot={target}", address]
    subprocess.run(command, check=True, capture_output=True, timeout=120)


#: Screens of programs, by the names of their pictures.
SCREENS: dict[str, Callable[[Study, Path], None]] = {"report": report_screen, "studio": studio_screen}

#: What draws each picture, by its name.
PICTURES: dict[str, Callable[[Study], Figure]] = {
    "motion": motion,
    "motion-limits": limits,
    "points-urscript": lambda study: printed(study, "urscript"),
    "points-krl": lambda study: printed(study, "krl"),
    "points-rapid": lambda study: printed(study, "rapid"),
    "points-libfranka": lambda study: printed(study, "libfranka", "generic-7r"),
    "points-csv": lambda study: printed(study, "csv", "tx40-like"),
    "points-joint_trajectory": lambda study: printed(study, "joint_trajectory"),
    "recording": recording,
    "filter": filtered,
    "outliers": outliers,
    "compared": compared,
    "rehearsal": rehearsed,
    "virtual-cell": cell,
    "drive-gains": gains,
    "payload": payload,
    "monitor": monitor,
    "servo-motions": servos,
    "track": track,
    "fleet": fleet,
    "parameters": parameters,
}


def draw(names: list[str], folder: Path) -> None:
    """Write pictures into a folder."""
    with tempfile.TemporaryDirectory() as place:
        study = Study(Path(place) / "scara")
        study.folder.mkdir()
        for name in names:
            if name in SCREENS:
                SCREENS[name](study, folder / f"{name}.png")
            else:
                PICTURES[name](study).savefig(folder / f"{name}.png", dpi=75)


if __name__ == "__main__":
    draw(sys.argv[1:] or [*PICTURES, *SCREENS], FIGURES)
