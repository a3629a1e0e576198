"""Numbers at their limits: threads, sizes, offsets and poor motions give a right answer or a refusal with a name."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.cli.main import main
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.files.estimate_file import read_estimate
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.robot import Robot

Capture = pytest.CaptureFixture[str]

#: How far results of one and of two threads may be apart, of the largest number of their kind.
THREADS = 1e-9

#: What an estimator has to be told of this log: its positions are exact, so no noise of theirs can be found.
TOLD = {"kalman": ("--option", "position_noise=1e-4")}

COMMAND = "import sys; from dynident.cli.main import main; sys.exit(main(sys.argv[1:]))"


def course(joints: int, seed: int = 0, samples: int = 1500) -> tuple[Array, Motion]:
    """Return times at 100 Hz and five sines a joint with their exact derivatives."""
    generator = np.random.default_rng(seed)
    time = np.arange(samples) / 100
    pulsation = 2 * np.pi * 0.2 * np.arange(1, 6)
    height = generator.uniform(-1, 1, (joints, 5)) / np.arange(1, 6)
    phase = time[:, None, None] * pulsation + generator.uniform(-np.pi, np.pi, (joints, 5))
    q, dq = np.sum(height * np.sin(phase), axis=-1), np.sum(height * pulsation * np.cos(phase), axis=-1)
    return time, Motion(q, dq, -np.sum(height * pulsation**2 * np.sin(phase), axis=-1))


def written(
    folder: Path, robot: Robot, change: Callable[[Motion], Motion] = lambda motion: motion, offset: Array | float = 0.0
) -> None:
    """Write a robot, the case and a log of a motion of it with the torque of its robot model and 1 % of noise."""
    (folder / "arm.json").write_text(json.dumps(robot_to_dict(robot)))
    model = DynamicModel(robot, ("viscous",))  # type: ignore[arg-type]
    assert robot.nominal is not None
    time, motion = course(robot.dof)
    motion = change(motion)
    clean = model.torque(motion, truth(robot))
    noise = 0.01 * clean.std(axis=0) * np.random.default_rng(1).normal(size=clean.shape)
    write_log(Log(robot.joint_names, time, motion.q, torque=clean + noise + offset), folder / "run.csv")
    how = "preprocessing: {filter: {butterworth: {cutoff_hz: 10}}}"
    (folder / "case.yaml").write_text(f"case: 1\nrobot: arm.json\nfriction: [viscous]\ntrain: run.csv\n{how}\n")


def truth(robot: Robot) -> Array:
    """Return bodies of the robot model and a tenth of the largest of them as viscous friction."""
    assert robot.nominal is not None
    return np.append(robot.nominal, np.full(robot.dof, 0.1 * np.abs(robot.nominal[:6]).max()))


def identified(folder: Path, capsys: Capture, *more: str) -> tuple[int, str]:
    code = main(
        ["identify", str(folder / "case.yaml"), "-o", str(folder / "e.json"), "--cross-validate", "0", *more, "--quiet"]
    )
    out, err = capsys.readouterr()
    return code, err if code else out


def check_answer(folder: Path, robot: Robot, share: float = 0.05) -> None:
    """The torque of the estimate is that of the robot on a motion that the fit has not seen."""
    estimate = read_estimate(folder / "e.json")
    model = DynamicModel(robot, ("viscous",))  # type: ignore[arg-type]
    _, motion = course(robot.dof, seed=9)
    expected = model.torque(motion, truth(robot))
    found = model.regressor(motion) @ estimate.base.to_standard(estimate.beta)
    error = np.linalg.norm(found - expected, axis=0) / np.linalg.norm(expected, axis=0)
    assert np.all(error < share), error


def check_refusal(code: int, text: str, words: str) -> None:
    assert code == 1 and text.startswith("error: ") and text.count("\n") == 1 and "Traceback" not in text
    assert words in text


SIZES = {"microscopic": (1e-6, 1e-3), "grams": (1e-3, 0.1), "tonnes": (1e3, 10.0)}


@pytest.mark.parametrize("estimator", ["consistent", "wls"])
@pytest.mark.parametrize("size", SIZES)
def test_robots_of_every_size(
    size: str, estimator: str, planar_2r: Robot, scaled: Callable[..., Robot], tmp_path: Path, capsys: Capture
) -> None:
    """From micrograms and millimetres, in the gravity of the earth, to arms of ten metres and tonnes."""
    mass, length = SIZES[size]
    robot = scaled(planar_2r, mass, length, 1.0)
    written(tmp_path, robot)
    code, text = identified(tmp_path, capsys, "--estimator", estimator)
    assert code == 0, text
    check_answer(tmp_path, robot)


def test_one_joint_only(planar_2r: Robot, tmp_path: Path, capsys: Capture) -> None:
    def one(motion: Motion) -> Motion:
        mask = np.array([1.0, 0.0])
        return Motion(motion.q * mask, motion.dq * mask, motion.ddq * mask)

    written(tmp_path, planar_2r, one)
    code, text = identified(tmp_path, capsys)
    check_refusal(code, text, "joint2")
    case = (tmp_path / "case.yaml").read_text()
    (tmp_path / "case.yaml").write_text(case + "locked: {joint2: 0.0}\n")
    code, text = identified(tmp_path, capsys)
    assert code == 0, text


@pytest.mark.parametrize("offset", [1e3, 1e6])
def test_huge_offsets_of_the_torque(offset: float, planar_2r: Robot, tmp_path: Path, capsys: Capture) -> None:
    """A sensor far off zero: with the part ``offset`` it is found, and takes nothing from the rest."""
    written(tmp_path, planar_2r, offset=np.array([offset, -offset]))
    case = (tmp_path / "case.yaml").read_text()
    (tmp_path / "case.yaml").write_text(case.replace("[viscous]", "[viscous, offset]"))
    code, text = identified(tmp_path, capsys)
    assert code == 0, text
    found = {p["name"]: p["value"] for p in read_estimate(tmp_path / "e.json").parameters()}
    assert found["F0[joint1]"] == pytest.approx(offset, rel=1e-3) and found["F0[joint2]"] == pytest.approx(
        -offset, rel=1e-3
    )
    expected = planar_2r.nominal
    assert expected is not None and found["Izz[link2]"] == pytest.approx(expected[15], rel=0.1)


def test_positions_many_turns_away(planar_2r: Robot, tmp_path: Path, capsys: Capture) -> None:
    """A turn more is the same pose: encoders that count a thousand turns give the same estimate."""
    turns = 2 * np.pi * np.array([1000.0, -250.0])
    written(tmp_path, planar_2r, lambda motion: replace(motion, q=motion.q + turns))
    code, text = identified(tmp_path, capsys)
    assert code == 0, text
    check_answer(tmp_path, planar_2r)


def figures(data: Any) -> list[float]:
    """Return all numbers of a JSON answer in their order, times of the run left out."""
    if isinstance(data, dict):
        return [x for key, value in data.items() if key not in ("seconds", "provenance") for x in figures(value)]
    if isinstance(data, list):
        return [x for value in data for x in figures(value)]
    return [float(data)] if isinstance(data, int | float) and not isinstance(data, bool) else []


def with_threads(folder: Path, threads: int, estimator: str) -> dict[str, Any]:
    """Return what a process with so many threads of BLAS, OpenMP and numba answers."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
    environment = {**os.environ, **dict.fromkeys(names, str(threads))}
    words = ["identify", "case.yaml", "--json", "--quiet", "--estimator", estimator, *TOLD.get(estimator, ())]
    done = subprocess.run(
        [sys.executable, "-c", COMMAND, *words], cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


def check_threads(folder: Path, estimator: str) -> None:
    one, two = (with_threads(folder, threads, estimator) for threads in (1, 2))
    for part in ("parameters", "train"):
        first, second = (np.array(figures(answer[part])) for answer in (one, two))
        assert len(first) == len(second) > 10
        assert np.abs(first - second).max() <= THREADS * np.abs(first).max(), estimator


def test_one_and_two_threads_agree(spatial_3r: Robot, tmp_path: Path) -> None:
    written(tmp_path, spatial_3r)
    check_threads(tmp_path, "consistent")


@pytest.mark.battery
@pytest.mark.parametrize("estimator", ESTIMATORS.names())
def test_one_and_two_threads_agree_for_every_estimator(estimator: str, planar_2r: Robot, tmp_path: Path) -> None:
    written(tmp_path, planar_2r)
    check_threads(tmp_path, estimator)


@pytest.mark.battery
def test_one_and_two_threads_design_the_same_motion() -> None:
    """SciPy, whose BLAS has threads of its own, is loaded by the search."""
    code = """
import dynident as di
model = di.DynamicModel(di.read_robot("generic-scara"), ["coulomb", "viscous"])
search, period = di.SearchOptions(starts=1, seed=0), di.TrajectoryOptions(period=8.0)
print(di.design_excitation(model, trajectory=period, search=search).values)
"""
    runs = [
        subprocess.run(
            [sys.executable, "-c", code],
            env=os.environ | {"OPENBLAS_NUM_THREADS": str(threads)}, capture_output=True, text=True, check=True,
        )
        for threads in (1, 2)
    ]  # fmt: skip
    assert runs[0].stdout == runs[1].stdout != ""
