"""The inputs of a recording: cases, plans, logs and an estimate, made once and used again by the newer recording."""

from __future__ import annotations

import csv
import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

from steps import Step

#: Runs a step, and fails where the command does.
Run = Callable[[Step], object]

_PREPARED = "preprocessing: {filter: {butterworth: {cutoff_hz: 10}}, rate_hz: 50, trim_s: 0.2}\n"
_SCARA = "case: 1\nrobot: generic-scara\n"
TEXTS = {
    "case.yaml": f"case: 1\nrobot: generic-6r\nfriction: [coulomb, viscous, offset]\n{_PREPARED}",
    "currents.yaml": "case: 1\nrobot: generic-6r\nfriction: [coulomb, viscous, offset]\n"
    f'log: {{columns: {{current: "i{{}}"}}}}\n{_PREPARED}',
    "scara.yaml": f"{_SCARA}friction: [coulomb, viscous]\n{_PREPARED}",
    "rotors.yaml": f"{_SCARA}friction: [coulomb, viscous, rotor_inertia]\n{_PREPARED}",
    "rich.yaml": f"{_SCARA}friction:\n  - asymmetric\n  - viscous\n  - offset\n  - stribeck: {{velocity: 0.1}}\n"
    f"  - periodic: {{cycles: 7}}\n  - rotor_inertia\n{_PREPARED}",
    "curved.yaml": f"{_SCARA}friction: [coulomb, degressive, polynomial, load]\n{_PREPARED}",
    "warm.yaml": f"{_SCARA}friction: [coulomb, viscous, temperature]\n"
    f'log: {{columns: {{temperature: "T{{}}"}}}}\n{_PREPARED}',
    "ros.yaml": f"{_SCARA}friction: [coulomb, viscous]\nlog: {{profile: joint_states}}\n{_PREPARED}",
    **{
        f"filter-{name}.yaml": f"{_SCARA}friction: [coulomb, viscous]\n"
        f"preprocessing: {{filter: {text}, rate_hz: 50, trim_s: 0.2}}\n"
        for name, text in {
            "five_point": "five_point",
            "fourier_fit": "{fourier_fit: {period_s: 4}}",
            "kalman_smoother": "kalman_smoother",
            "smoothing_spline": "smoothing_spline",
        }.items()
    },
    "constraints.yaml": "links:\n  forearm: {mass: {min: 3, max: 12}}\n",
    "benchmark.yaml": """benchmark: 1
title: small
robots: [generic-scara]
friction: [{coulomb: {width: 0.1}}, viscous]
motion: {train: scara-plan.json, test: scara-plan.json}
cell: {controller: {pd: {rate: 250}}, recorder: {rate: 250}}
rates_hz: [125]
duration_s: 4
noise:
  - {name: low, position: 1.0e-5, torque: 0.1}
draws: 1
preparations: {filtered: {filter: {butterworth: {cutoff_hz: 20}}}}
methods: {filtered: [ols, wls]}
""",
}

_NOISY = "--set effort.noise=0.3 --set recorder.rate=100"
_RUN = "simulate inputs/case.yaml inputs/plan.json"
STEPS = {
    "plan": "excite inputs/case.yaml --period 5 --harmonics 3 --starts 1 --seed 1 -o inputs/plan.json",
    "scara-plan": "excite inputs/scara.yaml --period 4 --harmonics 3 --starts 1 --seed 1 -o inputs/scara-plan.json",
    "seven-plan": "excite generic-7r --period 5 --harmonics 2 --starts 1 --seed 1 -o inputs/seven-plan.json",
    "other-plan": "excite inputs/case.yaml --period 5 --harmonics 2 --starts 1 --seed 2 -o inputs/other-plan.json",
    "run": f"{_RUN} --repeats 2 -o inputs/run.csv --seed 1 {_NOISY}",
    "other": f"{_RUN.replace('plan.json', 'other-plan.json')} --repeats 2 -o inputs/other.csv --seed 2 {_NOISY}",
    "loaded": f"{_RUN} --repeats 2 -o inputs/loaded.csv --seed 3 --set payload.mass=2 {_NOISY}",
    "fleet-1": f"{_RUN} -o inputs/fleet-1.csv --seed 11 --set truth.spread=0.05 {_NOISY}",
    "fleet-2": f"{_RUN} -o inputs/fleet-2.csv --seed 12 --set truth.spread=0.05 {_NOISY}",
    "currents": "simulate inputs/currents.yaml inputs/plan.json --repeats 2 -o inputs/currents.csv --seed 5 "
    "--set effort.noise=0.02 --set recorder.rate=100",
    "currents-loaded": "simulate inputs/currents.yaml inputs/plan.json --repeats 2 -o inputs/currents-loaded.csv "
    "--seed 6 --set effort.noise=0.02 --set recorder.rate=100 --set payload.mass=2",
    "estimate": "identify inputs/case.yaml inputs/run.csv --no-sensitivity -o inputs/estimate.json",
    "arm": "export inputs/estimate.json --to urdf -o inputs/arm.urdf --no-proof",
}
FULL = {
    f"scara-{kind}": "simulate inputs/scara.yaml inputs/scara-plan.json --repeats 3 --seed 7 --set effort.noise=0.1 "
    f"--set recorder.rate=100 -o inputs/scara.{kind}"
    for kind in ("csv", "npz", "mat", "parquet", "mcap")
} | {
    "warm": "simulate inputs/warm.yaml inputs/scara-plan.json --repeats 3 --seed 8 --set effort.noise=0.1 "
    "--set recorder.rate=100 --set warming.end=45 --set warming.time_constant=5 --set truth.friction.FcT=-0.02 "
    "-o inputs/warm.csv"
}


def make(tree: Path, folder: Path, tier: str, run: Run) -> None:
    """Make the inputs of a recording.

    Args:
        tree: Repository.
        folder: That of the recording.
        tier: ``quick`` or ``full``.
        run: Runs a step.
    """
    place = folder / "inputs"
    place.mkdir(parents=True)
    for name, text in TEXTS.items():
        (place / name).write_text(text, encoding="utf-8")
    for name, words in (STEPS | (FULL if tier == "full" else {})).items():
        run(Step(f"../inputs/made/{name}", words))
    _touched(place / "run.csv", place / "touched.csv")
    if tier == "full":
        shutil.copytree(tree / "examples" / "cases", place / "cases", ignore=shutil.ignore_patterns("*.yml"))
        _strangers(tree, place / "strangers", run)
    shutil.rmtree(place / "made")


def _touched(log: Path, target: Path) -> None:
    """Write a log with 60 N m from outside at the first joint for half a second, and other friction after it."""
    with log.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        time, speed = float(row["t"]), float(row["dq_ref2"])
        if 4.0 <= time < 4.5:
            row["tau1"] = repr(float(row["tau1"]) - 60.0)
        if time >= 7.0:
            row["tau2"] = repr(float(row["tau2"]) + (10.0 if speed > 0 else -10.0 if speed < 0 else 0.0))
    with target.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def _strangers(tree: Path, place: Path, run: Run) -> None:
    """Write description, logs and answered case of every stranger; a table says which logs are for what."""
    sys.path.insert(0, str(tree))
    from benchmarks.strangers.__main__ import answered, logs_of
    from benchmarks.strangers.cases import STRANGERS

    table = {}
    for name, stranger in STRANGERS.items():
        own = place / name
        own.mkdir(parents=True)
        *train, test = logs_of(name, stranger, own)
        table[name] = {"train": train, "test": [test], "options": list(stranger.options)}
        paths = " ".join(f"inputs/strangers/{name}/{log}" for log in train)
        words = f"init inputs/strangers/{name}/robot.urdf {paths} --test inputs/strangers/{name}/{test}"
        case = own / "case.yaml"
        run(
            Step(
                f"../inputs/made/{name}",
                f"{words} -o inputs/strangers/{name}/case.yaml {' '.join(stranger.options)}",
            )
        )
        case.write_text(answered(case.read_text(encoding="utf-8"), stranger), encoding="utf-8")
    (place / "strangers.json").write_text(json.dumps(table, indent=1), encoding="utf-8")
