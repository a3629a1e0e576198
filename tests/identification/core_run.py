"""Identifies a small arm with the core alone, and prints what it finds as JSON; `test_core_alone.py` runs it."""

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np

from dynident.arrays import plain
from dynident.data.formats import ColumnMap, write_log
from dynident.data.log import Log
from dynident.data.preprocessing import FILTERS, Preprocessing, default_preprocessing
from dynident.errors import UnknownChoice
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.files.estimate_file import read_estimate, summary, write_estimate
from dynident.identification.identify import identify
from dynident.identification.streaming.estimate import identify_digest
from dynident.identification.streaming.reduction import reduce_logs
from dynident.identification.streaming.stream_setup import StreamSetup
from dynident.identification.uncertainty.trust import TrustOptions
from dynident.identification.validate import validate
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion, default_friction
from dynident.model.inertia import Inertia
from dynident.model.joint import Joint
from dynident.model.robot import Link, Robot

#: Estimators that are compared.
METHODS = ("ols", "wls", "huber", "ridge", "consistent")


def small_arm() -> Robot:
    """Return two parallel joints about z, with gravity along -y."""
    offsets = ([0.0, 0.0, 0.0], [0.5, 0.0, 0.0])
    axis, turn = np.array([0.0, 0.0, 1.0]), np.eye(3)
    joints = [Joint(f"joint{i + 1}", "revolute", i - 1, turn, np.array(at), axis) for i, at in enumerate(offsets)]
    masses, centres = (3.0, 2.0), ([0.22, 0.03, 0.01], [0.18, -0.02, 0.02])
    links = [
        Link(f"link{i + 1}", Inertia.from_centre_of_mass(mass, centre, 0.02 * mass * np.diag([0.6, 0.8, 1.0])))
        for i, (mass, centre) in enumerate(zip(masses, centres, strict=True))
    ]
    return Robot("small-arm", tuple(links), tuple(joints), np.array([0.0, -9.81, 0.0]))


def motion_log(model: DynamicModel, seed: int) -> Log:
    """Return 20 s of a periodic motion with noise in positions and torques, and the commanded positions beside them."""
    noise, time = np.random.default_rng(seed), np.arange(2000) / 100.0
    pulsation = 2 * np.pi * 0.1 * np.arange(1, 6)
    sines = np.sin(time[:, None] * pulsation + noise.uniform(0, 6, 5))
    size = noise.normal(size=(5, 2)) / pulsation[:, None]
    q = sines @ size
    cosines = np.cos(time[:, None] * pulsation + noise.uniform(0, 6, 5))
    q += cosines @ size[::-1]
    dq = np.gradient(q, time, axis=0, edge_order=2)
    motion = Motion(q, dq, np.gradient(dq, time, axis=0, edge_order=2))
    assert model.robot.nominal is not None
    theta = np.append(model.robot.nominal, np.tile([0.5, 0.3, 0.1], 2))
    torque = model.torque(motion, theta) + 0.05 * noise.normal(size=q.shape)
    return Log(model.robot.joint_names, time, q + 1e-5 * noise.normal(size=q.shape), torque=torque, q_ref=q)


def main(folder: Path) -> dict[str, object]:
    """Return the figures of an identification from logs in memory, files and a stream."""
    model = DynamicModel(small_arm(), default_friction())  # type: ignore[arg-type]
    train, test = motion_log(model, 1), motion_log(model, 2)
    filtered = Preprocessing(FILTERS.make("butterworth", {"cutoff_hz": 8.0}), trim_s=0.5, rest="keep")
    found: dict[str, object] = {"base": list(base_parameters(model).names)}
    for method in METHODS:
        estimate = identify(model, [train], method, filtered)
        test_figures = validate(estimate, [test]).figures()
        found[method] = {"beta": estimate.beta, "std": estimate.std, "test": test_figures}
    whole = identify(
        model, [train], "consistent", default_preprocessing(), trust=TrustOptions(diagnose=True, bootstrap=40)
    )
    write_estimate(whole, folder / "estimate.json")
    assert np.array_equal(read_estimate(folder / "estimate.json").beta, whole.beta)
    found["diagnostics"] = {**summary(whole), "extras": None}
    write_log(train, folder / "run.csv")
    setup = StreamSetup(model, ColumnMap(joints=model.robot.joint_names), filtered)
    found["streamed"] = identify_digest(reduce_logs(setup, [folder / "run.csv"]), "wls").beta
    return found


def absent(wing: str) -> bool:
    """Return whether a wing is not there."""
    return importlib.util.find_spec(f"dynident.{wing}") is None


if __name__ == "__main__":
    if "--alone" in sys.argv:
        assert all(
            map(absent, ("api", "case", "robot_files", "simulation", "excitation", "diagnosis", "results", "cli"))
        )
        assert "iv" not in ESTIMATORS.names()
        try:
            ESTIMATORS.make("iv")
        except UnknownChoice as error:
            assert "wls" in str(error)
    sys.stdout.write(json.dumps(plain(main(Path(sys.argv[1])))))
