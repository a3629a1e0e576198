"""Random MJCFs: torques and regressor are those of MuJoCo, and what was identified returns into the files of each."""

from __future__ import annotations

import zlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mjcf_torques import torque_difference
from random_mjcf import RandomMjcf
from test_mjcf import assert_as_mujoco

from dynident.errors import DescriptionError
from dynident.exports.models.proving.robot_model_proof import reload_mjcf
from dynident.exports.models.subject.drives import drives_of
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.source import OwnDescription
from dynident.exports.models.writing.mjcf_own import beside, patched_mjcf
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import default_friction
from dynident.robot_files import read_robot
from dynident.robot_files.mjcf.model import read_mjcf_model
from dynident.robot_files.xml_elements import Element

mujoco = pytest.importorskip("mujoco")
pytestmark = [
    pytest.mark.filterwarnings("ignore:compiler attribute 'settotalmass'"),
    pytest.mark.filterwarnings("ignore:Attach conflict"),  # of gravity, which is that of the main model
]


def share(element: Element) -> float:
    """Return 1 to 1.5, the same for what is written once and stands for several bodies or joints."""
    return 1.0 + zlib.crc32(f"{Path(str(element.path)).name} {element.number}".encode()) / 2**33


def identified(path: Path) -> Identified:
    """Return the robot of a file with other bodies and friction."""
    model, tree = DynamicModel(read_robot(path), default_friction()), read_mjcf_model(path, path.read_bytes()).tree
    theta = model.nominal()
    assert theta is not None
    count = model.inertial_count
    for number, link in enumerate(model.robot.links):  # one between two joints of a body is in no file
        if link.name in tree.sources:
            theta[10 * number : 10 * number + 10] *= share(tree.sources[link.name].element)
    theta[count:] = [share(tree.joints[one.owner].element) * len(one.symbol) for one in model.parameters[count:]]
    estimate: Any = SimpleNamespace(model=model)
    return Identified(estimate, theta, "of the estimate", OwnDescription(path, path.read_bytes()))


@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=[pytest.mark.battery] if seed > 1 else []) for seed in range(280)]
)
def test_random_models_are_those_of_mujoco_before_and_after_they_are_written(seed: int, tmp_path: Path) -> None:
    """Of every second one each model is attached once: nothing of it is refused when it is written."""
    for name, text in RandomMjcf(seed, once=seed % 2 == 0).files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    path = tmp_path / "main.xml"
    assert torque_difference(read_robot(path), mujoco.MjModel.from_xml_path(str(path))) < 1e-9
    assert_as_mujoco(read_robot(path), path)
    subject = identified(path)
    assert subject.source is not None
    try:
        patched = patched_mjcf(subject, drives_of(subject), subject.source, lump=False, output=tmp_path / "out.xml")
    except DescriptionError as problem:
        assert seed % 2 and "its element stands for" in str(problem)
        return
    files = beside(tmp_path / "out.xml", subject.source, patched)
    (tmp_path / "proof").mkdir()
    for one in reload_mjcf(subject, subject.source, patched, files, tmp_path / "proof"):
        assert one.torque is not None and one.expected is not None, one.why_not
        wanted: Any = one.expected
        np.testing.assert_allclose(one.torque, wanted, rtol=0.0, atol=1e-9 * np.abs(wanted).max())
    for file, data in files.items():
        file.write_bytes(data)
    again = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    assert torque_difference(read_robot(tmp_path / "out.xml"), again) < 1e-9
