"""Virtual robots whose friction and delay are known: the draft, the choice, and the friction that is there.

Each robot is simulated with one law of friction, and a torque that is logged late or at once; what ``init`` drafts is
identified as it stands, with ``--friction auto``, and with the parts that are there. Beside the errors on an unseen
motion stands what each took for a delay, for the width of dry friction and the length of presliding, and whether it
took a Stribeck effect.

Run: python -m benchmarks.frictions [ROBOT ...]
"""

from __future__ import annotations

import argparse
import contextlib
import io
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.init_cases import against_model
from benchmarks.strangers import arms
from benchmarks.strangers.plant import Body, cylinder, urdf
from dynident import DynamicModel, FourierSeries, read_case, read_robot
from dynident.case.case import Case
from dynident.cli.main import main as dynident
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.identify import identify
from dynident.model.friction import FRICTION
from dynident.simulation.cell import Cell
from dynident.simulation.cell_simulation import simulate_cell
from dynident.simulation.controllers import CONTROLLERS
from dynident.simulation.effects import Bristles, Effort, Encoder, Recorder, Warming

#: Torque noise as a share of the largest torque, and noise of the positions in rad or m.
NOISE, SHAKE = 0.003, 1e-5

Parts = Sequence[tuple[str, Mapping[str, Any], Any]]


@dataclass(frozen=True)
class Virtual:
    """A robot with a law of friction.

    Attributes:
        bodies: Its joints and links.
        friction: Parts that are there: name, options, and for each joint the coefficient, or a row of them.
        rate: Samples a second.
        late: Samples by which the torque lags behind.
        first: Lowest frequency of its motion in Hz, of five harmonics.
        share: Share of the largest speeds that it reaches.
        cell: Further effects.
        truth: Parts to be identified with in place of those that are there, where these cannot be.
        periods: Periods of the motion in a log.
        controller: Its controller.
    """

    bodies: Sequence[Body]
    friction: Parts
    rate: float = 200.0
    late: float = 0.0
    first: float = 0.1
    share: float = 0.6
    cell: Cell = field(default_factory=Cell)
    truth: Parts = ()
    periods: int = 2
    controller: str = "computed_torque"

    @property
    def feeds(self) -> bool:
        """Whether the model is fed forward, so that drives do not stick at reversals."""
        return self.controller == "computed_torque"


def dry(width: float, values: Any) -> tuple[str, dict[str, Any], Any]:
    return ("coulomb", {"width": width}, values)


def planar() -> list[Body]:
    """Return an arm of three joints that lifts."""
    rows = (((0, 0, 0.3), (0, 0, 1), 6.0), ((0, 0, 0.1), (0, 1, 0), 5.0), ((0.4, 0, 0), (0, 1, 0), 3.0))
    return [
        Body(f"axis{k}", place, axis, (-2.5, 2.5), 3.0, 200, mass, (0.18, 0.01, 0.02), cylinder(mass, 0.05, 0.4, 0))
        for k, (place, axis, mass) in enumerate(rows, 1)
    ]


def gantry() -> list[Body]:
    """Return three slides that carry a wrist."""
    slides = (((0, 0, 1), (1, 0, 0), 40.0), ((0, 0, 0), (0, 1, 0), 18.0), ((0, 0, 0), (0, 0, 1), 7.0))
    found = [
        Body(
            f"slide{k}",
            place,
            axis,
            (-0.6, 0.6),
            1.0,
            800,
            mass,
            (0.02, 0, -0.1),
            cylinder(mass, 0.1, 0.3, 2),
            kind="prismatic",
        )
        for k, (place, axis, mass) in enumerate(slides, 1)
    ]
    return [
        *found,
        Body(
            "wrist", (0, 0, -0.2), (0, 1, 0), (-2, 2), 3.0, 40, 2.0, (0.05, 0.01, -0.08), cylinder(2.0, 0.04, 0.15, 2)
        ),
    ]


SEVEN, SIX = (5, 5, 4, 4, 1.5, 0.8, 0.6), (6, 7, 4, 1.3, 1.1, 0.9)
ROBOTS: Mapping[str, Virtual] = {
    "plain-3": Virtual(planar(), (dry(0.01, (4, 5, 3)), ("viscous", {}, (3, 4, 2)))),
    "plain-3-late": Virtual(planar(), (dry(0.01, (4, 5, 3)), ("viscous", {}, (3, 4, 2))), late=2),
    "plain-scara": Virtual(
        arms.scara(), (dry(0.005, (3, 2, 15, 0.3)), ("viscous", {}, (2, 1.2, 40, 0.05))), 500, 0, 0.2, 0.4
    ),
    "plain-7-late": Virtual(
        arms.gen3(),
        (
            dry(0.02, (1.2,) * 4 + (0.3,) * 3),
            ("viscous", {}, (2,) * 4 + (0.45,) * 3),
            ("rotor_inertia", {}, (0.3,) * 4 + (0.1,) * 3),
        ),
        200,
        1,
        0.06,
        0.8,
    ),
    "stribeck-7": Virtual(
        arms.iiwa(),
        (
            dry(0.005, SEVEN),
            ("viscous", {}, (9, 9, 5, 5, 3, 1, 1)),
            ("rotor_inertia", {}, (0.6, 0.8, 0.5, 0.5, 0.3, 0.15, 0.1)),
            ("stribeck", {"velocity": 0.06, "exponent": 2.0, "width": 0.005}, tuple(0.25 * x for x in SEVEN)),
        ),
        250,
        0,
        0.08,
        0.6,
    ),
    "stribeck-6-late": Virtual(
        arms.ur5e(),
        (
            dry(0.008, SIX),
            ("viscous", {}, (8, 8, 6, 1.5, 1.4, 1.2)),
            ("rotor_inertia", {}, (1.1, 1.1, 0.9, 0.12, 0.12, 0.12)),
            ("stribeck", {"velocity": 0.15, "exponent": 1.0, "width": 0.008}, tuple(0.3 * x for x in SIX)),
        ),
        250,
        3,
        0.06,
        0.5,
    ),
    "stribeck-gantry-late": Virtual(
        gantry(),
        (
            dry(0.004, (30, 20, 12, 0.8)),
            ("viscous", {}, (60, 40, 25, 0.5)),
            ("stribeck", {"velocity": 0.04, "exponent": 1.0, "width": 0.004}, (10, 6, 4, 0.25)),
        ),
        250,
        1,
        0.1,
        0.6,
    ),
    "load-6": Virtual(
        arms.ur5e(),
        (
            dry(0.005, SIX),
            ("viscous", {}, (8, 8, 6, 1.5, 1.4, 1.2)),
            ("rotor_inertia", {}, (1.1, 1.1, 0.9, 0.12, 0.12, 0.12)),
            ("load", {"width": 0.005}, (0.08,) * 6),
        ),
        250,
        0,
        0.06,
        0.6,
    ),
    "load-6-late": Virtual(
        arms.irb(),
        (
            dry(0.01, (60, 70, 40, 12, 8, 5)),
            ("viscous", {}, (40, 50, 25, 8, 5, 3)),
            ("rotor_inertia", {}, (30, 40, 18, 2, 1, 0.5)),
            ("degressive", {"width": 0.02}, (30, 35, 20, 6, 4, 2)),
            ("load", {"width": 0.01}, (0.06,) * 6),
        ),
        250,
        1,
        0.1,
        0.5,
    ),
    "one-way-6": Virtual(
        arms.xarm(),
        (
            ("asymmetric", {"width": 0.006}, ((3, 2), (3.5, 2.5), (2, 1.4), (1.5, 1.1), (1.4, 1), (0.9, 0.7))),
            ("viscous", {}, (3, 3, 2, 2, 2, 1.2)),
            ("rotor_inertia", {}, (0.5, 0.5, 0.4, 0.2, 0.15, 0.1)),
        ),
        200,
        0,
        0.08,
        0.6,
        truth=(dry(0.006, ()), ("offset", {}, ()), ("viscous", {}, ()), ("rotor_inertia", {}, ())),
    ),
    "warming-6": Virtual(
        arms.xarm(),
        (
            dry(0.01, (2, 2, 1.3, 1.3, 1.3, 0.8)),
            ("viscous", {}, (6, 6, 4, 3, 3, 2)),
            ("rotor_inertia", {}, (0.5, 0.5, 0.4, 0.2, 0.15, 0.1)),
        ),
        200,
        0,
        0.08,
        0.6,
        cell=Cell(warming=Warming((25.0,), (35.0,), 60.0, -0.02)),
    ),
    "presliding-6": Virtual(
        arms.ur5e(),
        (
            dry(0.01, tuple(0.4 * x for x in SIX)),
            ("viscous", {}, (8, 8, 6, 1.5, 1.4, 1.2)),
            ("rotor_inertia", {}, (1.1, 1.1, 0.9, 0.12, 0.12, 0.12)),
            ("presliding", {"length": 5e-3}, tuple(0.6 * x for x in SIX)),
        ),
        250,
        0,
        0.06,
        0.6,
    ),
    "presliding-7-late": Virtual(
        arms.iiwa(),
        (
            dry(0.005, tuple(0.3 * x for x in SEVEN)),
            ("viscous", {}, (9, 9, 5, 5, 3, 1, 1)),
            ("rotor_inertia", {}, (0.6, 0.8, 0.5, 0.5, 0.3, 0.15, 0.1)),
            ("presliding", {"length": 2e-3}, tuple(0.7 * x for x in SEVEN)),
        ),
        250,
        2,
        0.08,
        0.6,
    ),
    "bristles-6-late": Virtual(
        arms.ur5e(),
        (
            dry(0.01, SIX),
            ("viscous", {}, (8, 8, 6, 1.5, 1.4, 1.2)),
            ("rotor_inertia", {}, (1.1, 1.1, 0.9, 0.12, 0.12, 0.12)),
        ),
        250,
        2,
        0.06,
        0.6,
        cell=Cell(bristles=Bristles(2e-4, 0.3, 0.25, 0.03)),
        truth=(
            dry(0.002, ()),
            ("viscous", {}, ()),
            ("rotor_inertia", {}, ()),
            ("stribeck", {"velocity": 0.03, "exponent": 2.0, "width": 0.002}, ()),
        ),
    ),
}


def friction_of(parts: Parts) -> tuple[Any, ...]:
    return tuple(FRICTION.make(name, options) for name, options, _ in parts)


def motion_of(virtual: Virtual, seed: int, first: float) -> FourierSeries:
    """Return five harmonics a joint within its limits, at a share of its speeds."""
    generator, count = np.random.default_rng(seed), len(virtual.bodies)
    low, high = np.array([body.limits for body in virtual.bodies]).T
    reach, middle = np.minimum(0.4 * (high - low), 1.4), np.where(high - low > 6, 0.3, (low + high) / 2)
    a, b = generator.normal(size=(2, count, 5)) / np.arange(1, 6)
    raw = FourierSeries(np.zeros(count), a, b, 1 / first)
    q, dq, _ = raw.evaluate(np.linspace(0, 1 / first, 2000))
    speed = virtual.share * np.array([body.speed for body in virtual.bodies])
    scale = np.minimum(reach / np.abs(q).max(0), speed / np.abs(dq).max(0))[:, None]
    return FourierSeries(middle, a * scale, b * scale, 1 / first)


def logged(name: str, virtual: Virtual, folder: Path, seed: int, logs: int = 3) -> list[Path]:
    """Write the robot model, two logs to learn from and, of three, one on another motion to test on."""
    (folder / "robot.urdf").write_text(urdf(name, virtual.bodies))
    (folder / "truth.urdf").write_text(urdf(name, virtual.bodies, seed=seed))
    robot = read_robot(str(folder / "truth.urdf"))
    model = DynamicModel(robot, friction_of(virtual.friction))
    assert robot.nominal is not None
    values = [np.reshape(np.asarray(own, float), (robot.dof, -1)) for *_, own in virtual.friction]
    named = {}
    for part, own in zip(model.friction, values, strict=True):
        for coefficient, column in zip(part.coefficients, own.T, strict=True):
            named |= {
                f"{coefficient.symbol}[{joint}]": value for joint, value in zip(robot.joint_names, column, strict=True)
            }
    theta = np.array([*robot.nominal, *(named[p.name] for p in model.parameters[model.inertial_count :])])
    paths = []
    for k in range(logs):
        first = virtual.first * (1.2 if k == 2 else 1.0)
        motion = motion_of(virtual, 10 * seed + k, first)
        cell = replace(
            virtual.cell,
            controller=CONTROLLERS.make(virtual.controller, {"feedforward": "model"} if virtual.feeds else {}),
            encoder=Encoder(noise=(SHAKE,)),
            effort=Effort(delay_s=virtual.late / virtual.rate),
            recorder=Recorder(rate=virtual.rate),
            saturation=False,
        )
        run = simulate_cell(model, theta, motion, cell, duration=virtual.periods / first, seed=k)
        generator = np.random.default_rng([k, 9])
        tau = np.asarray(run.log.torque)
        tau = tau + NOISE * np.abs(tau).max(axis=0) * generator.normal(size=tau.shape)
        header = ",".join(
            ["time", *(f"q_{joint}" for joint in robot.joint_names), *(f"tau_{joint}" for joint in robot.joint_names)]
        )
        path = folder / f"log_{k}.csv"
        np.savetxt(
            path, np.column_stack([run.log.time, run.log.q, tau]), delimiter=",", header=header, comments="", fmt="%.9g"
        )
        paths.append(path)
    return paths


@dataclass(frozen=True)
class Row:
    """What came of a robot, by way: held-out errors, processor times, and what was found."""

    name: str
    errors: Mapping[str, float]
    seconds: Mapping[str, float]
    delays: Mapping[str, tuple[float, ...]]
    widths: Mapping[str, float]
    bent: Mapping[str, bool]
    slips: Mapping[str, float]


def fades(estimate: Estimate) -> bool:
    """Return whether the estimate has a Stribeck effect of more than a hundredth of the dry friction somewhere."""
    values = {p["name"]: p["value"] for p in estimate.parameters()}
    pairs = ((value, values.get(f"Fc[{name[3:]}")) for name, value in values.items() if name.startswith("Fs["))
    return any(dry is not None and value > 0.01 * max(dry, 0.0) for value, dry in pairs)


def drafted(folder: Path, train: Sequence[Path], more: Sequence[str] = ()) -> Case:
    """Return the case that ``init`` drafts of the robot model and logs in a folder."""
    case_file = folder / "case.yaml"
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as bad:
        code = dynident(["init", str(folder / "robot.urdf"), *map(str, train), *more, "-o", str(case_file)])
    text = case_file.read_text() if not code else ""
    if code or ": ask   # ask:" in text:
        raise RuntimeError(f"{bad.getvalue()}{[line for line in text.splitlines() if ': ask ' in line]}")
    return read_case(case_file)


def outcome(name: str, virtual: Virtual, folder: Path, ways: Sequence[str]) -> Row:
    """Return what comes of a robot."""
    *train, test = logged(name, virtual, folder, len(name))
    case = drafted(folder, train, ["--test", str(test)])
    learn, held = [case.read(path) for path in train], [case.read(test)]
    true = replace(case.model, friction=friction_of(virtual.truth or virtual.friction))
    right = replace(case.preprocessing, delay_s=virtual.late / virtual.rate)
    asked = {"draft": (case.model, case.preprocessing), "auto": (case.model, case.preprocessing), "true": (true, right)}
    errors, seconds, delays, widths, bent, slips = {}, {}, {}, {}, {}, {}
    for way in ways:
        model, how = asked[way]
        begin = time.process_time()
        found = identify(model, learn, "consistent", how, choose_friction=way == "auto")
        seconds[way] = time.process_time() - begin
        errors[way] = against_model(found, held).total_relative_error
        delays[way] = tuple(one.applied * virtual.rate for one in found.choices.delays or ())
        widths[way] = next((p.options["width"] for p in found.model.friction if "width" in p.options), np.nan)
        bent[way] = fades(found)
        slips[way] = max((p.options["length"] for p in found.model.friction if "length" in p.options), default=0.0)
    return Row(name, errors, seconds, delays, widths, bent, slips)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", choices=[*ROBOTS, []], default=[])
    parser.add_argument("--ways", nargs="+", default=["draft", "auto", "true"])
    options = parser.parse_args()
    print("| robot | samples late | way | held-out error | late | width | Stribeck | presliding | processor |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in options.robots or ROBOTS:
        with tempfile.TemporaryDirectory() as folder:
            row = outcome(name, ROBOTS[name], Path(folder), options.ways)
        for way in options.ways:
            late = ", ".join(f"{one:.2f}" for one in row.delays[way]) or "as stated"
            fading = "yes" if row.bent[way] else "no"
            slip = f"{1e3 * row.slips[way]:.2g} mrad" if row.slips[way] else "no"
            taken = f"{row.widths[way]:.4f} | {fading} | {slip} | {row.seconds[way]:.1f} s"
            figures = f"{row.errors[way]:.3%} | {late} | {taken}"
            print(f"| {name} | {ROBOTS[name].late:g} | {way} | {figures} |", flush=True)


if __name__ == "__main__":
    main()
