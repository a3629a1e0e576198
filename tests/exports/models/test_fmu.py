"""The functional mock-up unit: its description, its life by FMI 3.0, and its sources where no binary is."""

from __future__ import annotations

import ctypes
import subprocess
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from compiled_header import COMPILER, needs_compiler
from test_c_header import bare, states

from dynident.errors import FileError
from dynident.exports.models import ModelContent, export_model
from dynident.exports.models.fmu import Fmu, Unpacked, unpacked
from dynident.exports.models.proving.fmu_caller import Unit
from dynident.identification.estimate.estimate import Estimate
from dynident.model.robot import Robot

#: Of C, as strict as the header is held to.
WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-Wconversion", "-Wshadow")


def unit_of(estimate: Estimate, folder: Path) -> Unpacked:
    path = folder / "arm.fmu"
    export_model(estimate, "fmu", path, proof=False)
    return unpacked(path.read_bytes(), folder / "unit")


def instance(unit: Unpacked, exchange: bool = False) -> Unit:
    return Unit(str(next((unit.folder / "binaries").rglob("arm.*"))), unit.token, exchange)


def value(unit: Unit, reference: int) -> float:
    found = (ctypes.c_double * 1)()
    unit.call("fmi3GetFloat64", (ctypes.c_uint32 * 1)(reference), ctypes.c_size_t(1), found, ctypes.c_size_t(1))
    return found[0]


def put(unit: Unit, reference: int, new: float) -> None:
    values = (ctypes.c_double * 1)(new)
    unit.call("fmi3SetFloat64", (ctypes.c_uint32 * 1)(reference), ctypes.c_size_t(1), values, ctypes.c_size_t(1))


@needs_compiler
def test_the_description_names_units_starts_and_what_outputs_depend_on(sliding_arm: Robot, tmp_path: Path) -> None:
    unit = unit_of(bare(sliding_arm, ("coulomb", "load", "temperature")), tmp_path)
    root = ElementTree.fromstring((unit.folder / "modelDescription.xml").read_bytes())
    of = {one.attrib["name"]: one.attrib for one in root.iterfind("ModelVariables/Float64")}
    size = sliding_arm.dof
    sliding = [i for i, joint in enumerate(sliding_arm.active, start=1) if joint.kind == "prismatic"]
    assert sliding and len(of) == 1 + 10 * size
    for i in range(1, size + 1):
        units = ("m", "m/s", "m/s2", "degC", "N") if i in sliding else ("rad", "rad/s", "rad/s2", "degC", "N.m")
        kinds = ("q", "dq", "ddq", "temperature", "tau")
        assert tuple(of[f"{kind}[{i}]"]["unit"] for kind in kinds) == units
        assert float(of[f"q[{i}]"]["start"]) == 0 and float(of[f"temperature[{i}]"]["start"]) == 20
    known = {one.attrib["name"] for one in root.iterfind("UnitDefinitions/Unit")}
    assert {one["unit"] for one in of.values()} <= known
    depends = {
        one.attrib["valueReference"]: one.attrib["dependencies"].split()
        for one in root.iterfind("ModelStructure/Output")
    }
    gravity, friction = (depends[of[f"{kind}[1]"]["valueReference"]] for kind in ("gravity", "friction"))
    assert gravity == [of[f"q[{i}]"]["valueReference"] for i in range(1, size + 1)]
    assert len(friction) == 4 * size  # the load is that of all inputs
    arm = instance(unit)
    assert value(arm, unit.references["temperature[1]"]) == 20


@needs_compiler
def test_the_life_of_a_unit(spatial_3r: Robot, tmp_path: Path) -> None:
    unit = unit_of(bare(spatial_3r, ("viscous",)), tmp_path)
    tau, speed = unit.references["tau[1]"], unit.references["dq[1]"]
    arm = instance(unit)
    before = value(arm, tau)
    state = ctypes.c_void_p(None)
    arm.call("fmi3GetFMUState", ctypes.byref(state))
    put(arm, speed, 2.0)
    moved = value(arm, tau)
    assert moved != before
    arm.call("fmi3SetFMUState", state)
    assert value(arm, tau) == before
    arm.call("fmi3FreeFMUState", ctypes.byref(state))
    for wrong in (lambda: put(arm, tau, 1.0), lambda: put(arm, 0, 1.0), lambda: value(arm, 10_000)):
        with pytest.raises(RuntimeError, match="status 3"):
            wrong()
    with pytest.raises(RuntimeError, match="fmi3EnterEventMode gives the status 3"):
        arm.call("fmi3EnterEventMode")  # Co-Simulation has none
    put(arm, speed, 2.0)
    arm.call("fmi3Terminate")
    arm.call("fmi3Reset")
    assert value(arm, speed) == 0.0
    with pytest.raises(RuntimeError, match="no instance"):
        Unit(str(next((unit.folder / "binaries").rglob("arm.*"))), "{another}", False)
    exchange = instance(unit, exchange=True)
    exchange.call("fmi3EnterEventMode")
    put(exchange, speed, 2.0)
    assert value(exchange, tau) == moved


@needs_compiler
@pytest.mark.parametrize("friction", [("asymmetric", "degressive", "temperature"), ("viscous", "presliding")])
def test_the_sources_compile_without_a_warning_alone_and_with_a_prefix(
    coupled_arm: Robot, friction: tuple[str, ...], tmp_path: Path
) -> None:
    folder = unit_of(bare(coupled_arm, friction), tmp_path).folder / "sources"
    assert COMPILER is not None
    for extra in ((), ("-DFMI3_FUNCTION_PREFIX=arm_",)):
        command = [COMPILER, *WARNINGS, *extra, "-fsyntax-only", "fmi3.c"]
        found = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
        assert found.returncode == 0, found.stderr[:2000]


def test_without_a_compiler_it_has_sources_only_and_says_so(
    pendulum: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.which", lambda name: None)
    found = export_model(bare(pendulum, ("viscous",)), "fmu", tmp_path / "arm.fmu")
    assert "sources only" in found.notes[0] and "CC" in found.notes[0]
    assert found.proofs[0].why_not and found.proofs[0].relative is None
    with zipfile.ZipFile(tmp_path / "arm.fmu") as source:
        names = source.namelist()
    assert "sources/buildDescription.xml" in names and not any(name.startswith("binaries") for name in names)


@needs_compiler
def test_a_unit_with_other_torques_is_refused(pendulum: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = Fmu.content

    def wrong(self: Fmu, subject: object, path: Path) -> ModelContent:
        other = bare(pendulum, ("coulomb", "viscous"))
        return whole(self, type(subject)(other, np.asarray(other.theta) * 1.00001, "of the estimate"), path)  # type: ignore[call-arg]

    monkeypatch.setattr(Fmu, "content", wrong)
    with pytest.raises(FileError, match="torques that differ"):
        export_model(bare(pendulum, ("coulomb", "viscous")), "fmu", tmp_path / "arm.fmu")
    assert not list(tmp_path.iterdir())


@needs_compiler
def test_fmpy_finds_no_fault_and_simulates_it(coupled_arm: Robot, tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
    estimate = bare(coupled_arm, ("coulomb", "viscous"))
    found = export_model(estimate, "fmu", tmp_path / "arm.fmu")
    assert [proof.relative is not None for proof in found.proofs if proof.engine.startswith("FMPy")] == [True]
    motion = states(estimate.model, 1)
    size = estimate.model.robot.dof
    starts = {f"{kind}[{i + 1}]": getattr(motion, kind)[0, i] for kind in ("q", "dq", "ddq") for i in range(size)}
    asked = [f"tau[{i + 1}]" for i in range(size)]
    told = {"start_values": starts, "output": asked, "stop_time": 0.01}
    expected = estimate.model.torque(motion, np.asarray(estimate.theta))[0]
    for kind in ("CoSimulation", "ModelExchange"):
        rows = fmpy.simulate_fmu(str(tmp_path / "arm.fmu"), fmi_type=kind, **told)
        np.testing.assert_allclose([rows[name][-1] for name in asked], expected, rtol=1e-12)


def test_a_name_that_no_simulator_knows_is_refused(pendulum: Robot, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"write -o arm\.fmu"):
        export_model(bare(pendulum, ("viscous",)), "fmu", tmp_path / "arm.m")
    assert not list(tmp_path.iterdir())
