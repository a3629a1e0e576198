"""What every exporter of models must do, whatever it writes: one battery for the whole folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bare_estimates import bare_estimate
from dynident.arrays import Array
from dynident.data.log import Log
from dynident.errors import DynidentError, FileError, NotConsistent
from dynident.exports.base import Exporter
from dynident.exports.c_compiler import find_compiler
from dynident.exports.models import MODEL_EXPORTERS, ModelExport, export_model, model_export_data
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.identify import identify
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.robot import Robot

PARTS = MODEL_EXPORTERS.names()

ROBOTS = ("pendulum", "sliding_arm", "mimic_arm", "coupled_arm")

#: Friction of the estimates.
FRICTIONS = ("coulomb", "viscous", "offset", "rotor_inertia")


@pytest.fixture(scope="module")
def estimates(request: pytest.FixtureRequest, exact_log: Callable[..., Log]) -> dict[str, Estimate]:
    """Return a consistent estimate of each robot, the values those of its robot model and drawn friction."""
    return {name: made(request.getfixturevalue(name), exact_log) for name in ROBOTS}


def made(robot: Robot, exact_log: Callable[..., Log], estimator: str = "consistent") -> Estimate:
    model = DynamicModel(robot, FRICTIONS)  # type: ignore[arg-type]
    theta = drawn(model)
    return identify(model, [exact_log(model, theta, noise=0.01)], estimator)


def drawn(model: DynamicModel) -> Array:
    """Return the bodies of the robot model with drawn friction, shape (p,)."""
    theta = model.nominal()
    assert theta is not None
    theta = theta.copy()
    theta[model.inertial_count :] = np.random.default_rng(1).uniform(0.1, 0.5, len(theta) - model.inertial_count)
    return theta


def written(estimate: Estimate, name: str, folder: Path, proof: bool = True) -> tuple[ModelExport, dict[str, bytes]]:
    folder.mkdir(exist_ok=True)
    found = export_model(estimate, name, folder / f"arm{MODEL_EXPORTERS.get(name).suffix}", proof=proof)
    return found, {Path(file).name: Path(file).read_bytes() for file in found.files}


def away(found: ModelExport) -> float:
    """Return the largest relative difference by engines of double precision."""
    assert all((proof.relative or 0.0) <= proof.allowed for proof in found.proofs)
    return max(proof.relative or 0.0 for proof in found.proofs if proof.allowed <= 1e-6)


@pytest.mark.parametrize("name", PARTS)
def test_a_part_says_what_it_takes_and_writes(name: str) -> None:
    part = MODEL_EXPORTERS.make(name)
    assert isinstance(part, Exporter) and part.takes == "estimate"
    assert part.suffix.startswith(".") and not part.writes_folder


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_every_engine_gives_the_same_torques(
    estimates: dict[str, Estimate], name: str, robot: str, tmp_path: Path
) -> None:
    found, files = written(estimates[robot], name, tmp_path)
    asked = [proof for proof in found.proofs if proof.relative is not None]
    assert asked and all(proof.why_not for proof in found.proofs if proof.relative is None)
    assert away(found) < 1e-9
    assert {path.name for path in tmp_path.iterdir()} == set(files)
    said = MODEL_EXPORTERS.get(name).proof
    for engine in {proof.engine for proof in found.proofs}:
        assert engine.split(" ")[0] in said or (find_compiler() and engine == find_compiler().name), engine  # type: ignore[union-attr]


@pytest.mark.parametrize("name", PARTS)
def test_the_same_estimate_gives_the_same_bytes_and_a_check_writes_none(
    estimates: dict[str, Estimate], name: str, tmp_path: Path
) -> None:
    estimate = estimates["pendulum"]
    _, first = written(estimate, name, tmp_path / "a", proof=False)
    _, second = written(estimate, name, tmp_path / "b", proof=False)
    assert first == second
    found = export_model(estimate, name, tmp_path / f"c{MODEL_EXPORTERS.get(name).suffix}", write=False, proof=False)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"] and not found.proofs
    assert set(model_export_data(found)) == set(ModelExport.__dataclass_fields__)


@pytest.mark.parametrize("name", PARTS)
def test_base_parameters_get_possible_bodies_with_the_same_torques(
    planar_2r: Robot, exact_log: Callable[..., Log], name: str, tmp_path: Path
) -> None:
    estimate = made(planar_2r, exact_log, "wls")
    theta = drawn(estimate.model)  # those of a noisy fit need not be those of any robot
    estimate = replace(estimate, beta=estimate.base.from_standard(theta))
    found, _ = written(estimate, name, tmp_path)
    assert found.parameters == "chosen behind its base parameters"
    assert any("single masses are not measured" in note for note in found.notes)


@pytest.mark.parametrize("name", PARTS)
def test_base_parameters_of_no_robot_are_refused_or_told(
    planar_2r: Robot, exact_log: Callable[..., Log], name: str, tmp_path: Path
) -> None:
    estimate = made(planar_2r, exact_log, "wls")
    wrong = replace(estimate, beta=np.where([n == "Fv[joint2]" for n in estimate.base.names], -1.0, estimate.beta))
    if MODEL_EXPORTERS.get(name).needs_bodies:
        with pytest.raises(NotConsistent, match=r"Fv\[joint2\].*dynident identify .* --estimator consistent"):
            written(wrong, name, tmp_path / "x")
        assert not list((tmp_path / "x").iterdir())
    else:
        found, _ = written(wrong, name, tmp_path / "x")
        assert found.parameters == "none" and away(found) < 1e-9


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("word", ['"; import os #', "a'b\\", "=1+1", "</robot>", "$(x) & %", "ü\u2028", "a\nb"])
def test_hostile_names_are_text_or_refused(
    estimates: dict[str, Estimate], name: str, word: str, tmp_path: Path
) -> None:
    """What is written still loads with the same torques; what cannot be is refused before anything is written."""
    estimate = estimates["pendulum"]
    robot = estimate.model.robot
    joints = (replace(robot.joints[0], name=word),)
    links = (replace(robot.links[0], name=f"{word}1"),)
    model = replace(estimate.model, robot=replace(robot, name=word, joints=joints, links=links))
    base = replace(estimate.base, parameters=model.parameters)
    try:
        found, files = written(replace(estimate, model=model, base=base), name, tmp_path / "x")
    except DynidentError as error:
        assert not list((tmp_path / "x").iterdir())
        assert "rename" in str(error) or "names" in str(error)
        return
    assert away(found) < 1e-9
    for file, data in files.items():
        if not file.endswith(".fmu"):  # an archive
            data.decode("utf-8")


@pytest.mark.parametrize("name", ["urdf", "pinocchio", "mjcf", "sdf", "drake", "numpy"])
@pytest.mark.parametrize("suffix", ["", ".urdf", ".xml"])
def test_the_name_of_a_file_changes_nothing(
    estimates: dict[str, Estimate], name: str, suffix: str, tmp_path: Path
) -> None:
    """Also with gravity that no engine takes by itself."""
    estimate = estimates["sliding_arm"]
    robot = estimate.model.robot.with_gravity([3.0, -4.0, 5.0])
    tilted = replace(estimate, model=replace(estimate.model, robot=robot))
    found = export_model(tilted, name, tmp_path / f"arm{suffix}")
    assert max(proof.relative or 0.0 for proof in found.proofs) < 1e-9


@pytest.mark.parametrize("file", ["arm.sdf", "package.xml"])
def test_directives_do_not_take_the_place_of_the_files_that_they_name(
    estimates: dict[str, Estimate], file: str, tmp_path: Path
) -> None:
    with pytest.raises(FileError, match=r"call it NAME\.dmd\.yaml"):
        export_model(estimates["pendulum"], "drake", tmp_path / file)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", PARTS)
def test_gravity_of_a_tilted_base_is_kept(estimates: dict[str, Estimate], name: str, tmp_path: Path) -> None:
    estimate = estimates["sliding_arm"]
    robot = estimate.model.robot.with_gravity([3.0, -4.0, 5.0])
    found, _ = written(replace(estimate, model=replace(estimate.model, robot=robot)), name, tmp_path)
    assert away(found) < 1e-9


@pytest.mark.parametrize("name", ["numpy", "json", "ros2_friction", "c_header", "casadi", "fmu"])
def test_every_friction_part_that_ships_is_held(spatial_3r: Robot, name: str, tmp_path: Path) -> None:
    """These formats hold every part; the others say which they leave out."""
    aside = ["coulomb", "asymmetric", "load_directional"]
    aside += ["warm_up"] if name not in ("json", "ros2_friction") else []  # its state needs the time: refused
    rest = [part for part in FRICTION.names() if part not in aside]
    for parts in (("coulomb", *rest), ("asymmetric", "viscous")):
        model = DynamicModel(spatial_3r, tuple(parts))  # type: ignore[arg-type]
        path = tmp_path / ("x.fmu" if name == "fmu" else "x.py")
        found = export_model(bare_estimate(model, drawn(model)), name, path)
        assert away(found) < 1e-9 and not found.left_out


@pytest.mark.parametrize("name", ["urdf", "mjcf", "sdf", "pinocchio", "drake"])
def test_what_does_not_fit_is_told(spatial_3r: Robot, name: str, tmp_path: Path) -> None:
    model = DynamicModel(spatial_3r, ("asymmetric", "viscous", "polynomial", "periodic"))  # type: ignore[arg-type]
    estimate = bare_estimate(model, drawn(model))
    found = export_model(estimate, name, tmp_path / f"x{MODEL_EXPORTERS.get(name).suffix}")
    assert {"Fv2", "Fv3", "Ps1", "(Fc+ - Fc-)/2"} <= {term.symbol for term in found.left_out}
    assert min(found.neglected.values()) > 0.05 and set(found.neglected) == set(spatial_3r.joint_names)
    assert found.files[-1].endswith(".dynident.json")
