"""Drive gains and motor-side logs of real robots; skipped where the logs are missing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.case.case import read_case
from dynident.cli.main import main
from dynident.diagnosis.examination import examine
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.identify import identify
from dynident.robot_files import read_robot
from real_data import DATA, real

pytestmark = pytest.mark.battery

ROOT = Path(__file__).resolve().parents[2]

#: Published gains of the UR10e in N m/A, as the data set's README has them: De Luca; Mamedov and Mikhel.
DE_LUCA = np.array([14.87, 13.26, 11.13, 10.62, 11.03, 11.47])
MAMEDOV = np.array([10.0, 10.6956, 8.4566, 9.0029, 9.48, 10.1232])


def asked(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> dict[str, Any]:
    assert main([*arguments, "--json"]) == code
    return json.loads(capsys.readouterr().out)


def test_ur10e_gains_from_a_weighed_load(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They lie between the published sets, and predict held-out runs better than those of De Luca.

    At a joint by 3 % at most worse: the largest share is that of wrist_1, whose gain is De Luca's within its
    interval. There the squared errors of the runs differ by 1.7 standard errors over blocks of 2 s.
    """
    runs = real("ur10e_mamedov", monkeypatch)
    case, out = str(ROOT / "examples" / "cases" / "ur10e.yaml"), str(tmp_path / "gains.yaml")
    free, heavy = str(runs / "ident_20_01_31_unload.csv"), str(runs / "ident_20_01_13_load_2600.csv")
    found = asked(capsys, "gains", case, free, "--load", heavy, "--mass", "2.602", "-o", out)
    assert found["complete"] is True
    values = np.array([gain["gain"] for gain in found["gains"]])
    assert np.all(values > MAMEDOV) and np.all(values < 1.02 * DE_LUCA)
    assert all(gain["high"] - gain["low"] < 0.2 * gain["gain"] for gain in found["gains"])
    assert [gain["low"] <= de_luca <= gain["high"] for gain, de_luca in zip(found["gains"], DE_LUCA, strict=True)] == [
        False, False, False, True, False, True,
    ]  # fmt: skip
    stated = asked(capsys, "identify", case, "--estimator", "wls", "--cross-validate", "0")
    own = asked(capsys, "identify", out, "--estimator", "wls", "--cross-validate", "0")
    errors = [[joint["relative_error"] for joint in fit["test"]["joints"]] for fit in (own, stated)]
    shares = np.divide(*errors)  # a total would weigh joints by their gains
    assert np.exp(np.mean(np.log(shares))) < 0.99 and np.all(shares < 1.03)
    assert set(own["extras"]["gain_std"]["relative"]) == {gain["joint"] for gain in found["gains"]}


def tx40_case(path: Path, log: Path, lines: str) -> Path:
    names = read_robot(DATA / "staubli_tx40_figaroh" / "robot.urdf").joint_names
    drives = ", ".join(f"{name}: {{gear_ratio: {n}}}" for name, n in zip(names, (32, 32, 45, -48, 45, 32), strict=True))
    path.write_text(
        f"case: 1\nrobot: {DATA / 'staubli_tx40_figaroh' / 'robot.urdf'}\ndrives: {{{drives}}}\n"
        "coupling: [[1,0,0,0,0,0],[0,1,0,0,0,0],[0,0,1,0,0,0],[0,0,0,1,0,0],[0,0,0,0,1,0],[0,0,0,0,1,1]]\n"
        "friction: [coulomb, viscous, offset, rotor_inertia]\n"
        "preprocessing: {filter: {butterworth: {cutoff_hz: 50}}, rate_hz: 500, trim_s: 0}\n"
        f"estimator: wls\n{lines}train: {log}\n"
    )
    return path


def test_the_motors_of_the_tx40_give_the_base_parameters_of_its_joints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same rows from both sides give the same parameters to what seven digits of the files leave, and the log of
    the joints at 5 kHz gives them within their deviations: another rate is another filter of the noise."""
    runs = real("staubli_tx40_figaroh", monkeypatch)
    motors = tx40_case(
        tmp_path / "motors.yaml",
        runs / "motor_side_1kHz.csv",
        "log: {side: motor, columns: {q: 'qm{}', torque: 'taum{}'}, zero: [0, -pi/2, pi/2, 0, 0, 0]}\n",
    )
    joints = tx40_case(tmp_path / "joints.yaml", runs / "trajectory.csv", "")
    at_motors, at_joints = read_case(motors), read_case(joints)
    log = at_joints.read(runs / "trajectory.csv")

    def estimated(case: Any, log: Any) -> Estimate:
        return identify(case.model, [log], "wls", case.preprocessing)

    one = estimated(at_motors, at_motors.read(runs / "motor_side_1kHz.csv"))
    same = estimated(at_joints, log.rows(slice(None, None, 5), "every fifth row"))
    whole = estimated(at_joints, log)
    assert one.base.names == same.base.names
    assert np.max(np.abs(one.beta - same.beta) / same.std) < 0.01
    assert np.max(np.abs(one.beta - whole.beta) / whole.std) < 1.0


def test_the_wrist_channels_of_tiago_are_named_and_the_rest_is_identified(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    real("tiago_figaroh", monkeypatch)
    path = ROOT / "examples" / "cases" / "tiago.yaml"
    case = read_case(path)
    coarse = [one.joint for one in examine(case, case.train[0]).findings if "coarse" in one.name]
    assert coarse == ["arm_5_joint, arm_6_joint, arm_7_joint"]
    found = asked(capsys, "identify", str(path), "--cross-validate", "0")
    fits = {joint["name"]: joint["r2"] for joint in found["test"]["joints"]}
    assert all(fits[f"arm_{k}_joint"] >= 0.97 for k in (1, 2, 3, 4)), fits
    named = {warning.split(":")[0] for warning in found["warnings"]}
    assert {"arm_5_joint", "arm_6_joint", "arm_7_joint"} <= named
    gains = asked(capsys, "gains", str(path), "--prior-share", "0.1", code=1)
    known = {gain["joint"]: gain for gain in gains["gains"]}
    for k, documented in ((3, -8.7), (4, -8.7)):
        assert known[f"arm_{k}_joint"]["low"] <= documented <= known[f"arm_{k}_joint"]["high"]
    assert all(known[f"arm_{k}_joint"]["label"] == "not determined" for k in (5, 6, 7))
