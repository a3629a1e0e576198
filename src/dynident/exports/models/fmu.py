"""A functional mock-up unit by FMI 3.0 for system simulators: inverse dynamics in C, sources and binary.

Its proof: the archive read again, its library called, FMPy where it is installed.
"""

from __future__ import annotations

import importlib
import io
import json
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar, Final
from xml.etree import ElementTree

import numpy as np

from dynident.arrays import Array
from dynident.errors import FileError
from dynident.exports.c_compiler import PATIENCE, NoCompilerRuns, build_library, find_compiler
from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.proving import fmu_caller
from dynident.exports.models.subject.drives import drives_of
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import StateSet
from dynident.exports.models.writing.c_text import check_names, prefix_of
from dynident.exports.models.writing.document import document_bytes
from dynident.exports.models.writing.fmu_text import DESCRIPTION, SOURCE, archive, built, platform_tuple, unit_files


@dataclass(frozen=True)
class Fmu(ModelExporter):
    """FMU by FMI 3.0: torque of the drives and its parts from q, dq, ddq; C sources, and a binary for this machine.

    Attributes:
        prefix: Its model identifier: small letters, digits and '_'; empty for the name of the file.
        velocity_scale: Least smoothing width of Coulomb friction in 'feed_forward', in rad/s (or m/s).
        binary: Whether a binary for this machine is built where a C compiler is there; false for sources only.
    """

    prefix: str = ""
    velocity_scale: float = 0.05
    binary: bool = True

    suffix: ClassVar[str] = ".fmu"
    proof: ClassVar[str] = "everything by calls by FMI 3.0 of its library, or of one by a C compiler; by FMPy"
    remembers: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_names(self.prefix, self.velocity_scale)

    def content(self, subject: Identified, path: Path) -> ModelContent:
        if path.suffix.lower() != self.suffix:
            raise FileError(path, "simulators know a functional mock-up unit by .fmu", f"write -o {path.stem}.fmu")
        identifier = prefix_of(self.prefix, path)
        files = unit_files(subject, identifier, self.velocity_scale, document_bytes(subject, drives_of(subject)))
        note = "sources only, as asked for: simulators that do not compile them cannot use it"
        if self.binary:
            libraries, note = _libraries(files, identifier)
            files |= libraries
        notes = [
            note,
            "inputs q[i], dq[i], ddq[i] by joint, outputs tau[i] and its parts; Model Exchange, Co-Simulation",
        ]
        return ModelContent({path: archive(files)}, (), tuple(notes))

    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: StateSet) -> Iterator[Reloaded]:
        yield from proofs_of_unit(subject, next(iter(content.files.values())), folder, states)


def _libraries(files: dict[str, bytes], identifier: str) -> tuple[dict[str, bytes], str]:
    """Return the binaries that can be built here, and what is to be said about them."""
    name, compiler = platform_tuple()[0], find_compiler()
    only = "sources only, which simulators have to compile"
    if not name:
        return {}, f"{only}: FMI has no name for this machine"
    if compiler is None:
        return {}, f"{only}: none of cc, gcc, clang is on the path; set CC to name another"
    with tempfile.TemporaryDirectory(prefix="dynident-") as folder:
        try:
            return built(files, identifier, Path(folder), compiler), f"binary for {name}; elsewhere from its sources"
        except NoCompilerRuns as error:
            return {}, f"{only}: {compiler.name}: {error}"


#: Parts whose sum is the torque.
PARTS: Final = ("gravity", "coriolis", "inertia", "friction")


@dataclass(frozen=True)
class Unpacked:
    """A unit as its archive says it is.

    Attributes:
        folder: Where its files lie.
        identifier: Its model identifier.
        token: Its instantiation token.
        references: Value references by name.
    """

    folder: Path
    identifier: str
    token: str
    references: dict[str, int]

    def of(self, kinds: Sequence[str], size: int) -> list[int]:
        """Return the value references of some kinds of variables, joint by joint of each."""
        return [self.references[f"{kind}[{i}]"] for kind in kinds for i in range(1, size + 1)]


def unpacked(data: bytes, folder: Path) -> Unpacked:
    """Write the files of an archive into a folder and read its description.

    Raises:
        ValueError: An entry that does not belong there.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as source:
        for entry in source.infolist():
            place = (folder / entry.filename).resolve()
            if folder.resolve() not in place.parents:
                raise ValueError(f"the archive has an entry '{entry.filename}' outside of it")
        source.extractall(folder)
    root = ElementTree.fromstring((folder / DESCRIPTION).read_bytes())
    simulation = root.find("CoSimulation")
    assert simulation is not None
    variables = root.iterfind("ModelVariables/Float64")
    references = {one.attrib["name"]: int(one.attrib["valueReference"]) for one in variables}
    return Unpacked(folder, simulation.attrib["modelIdentifier"], root.attrib["instantiationToken"], references)


def proofs_of_unit(subject: Identified, data: bytes, folder: Path, states: StateSet) -> Iterator[Reloaded]:
    """Return the torques that engines find in a unit, by its binary or, where it has none, by its sources."""
    unit = unpacked(data, folder / "unit")
    name, suffix = platform_tuple()
    library, compiler = unit.folder / "binaries" / name / f"{unit.identifier}{suffix}", find_compiler()
    what = "binary"
    if not library.is_file():
        what = "sources"
        if compiler is None or not name:
            yield Reloaded("C compiler", why_not="none of cc, gcc, clang is on the path; set CC to name another")
            yield from _by_fmpy(subject, unit, folder, states, False)
            return
        library = unit.folder / "sources" / f"{unit.identifier}{suffix}"
        try:
            build_library(compiler, library.parent, SOURCE, library.name)
        except NoCompilerRuns as error:
            yield Reloaded(compiler.name, why_not=str(error))
            yield from _by_fmpy(subject, unit, folder, states, False)
            return
    yield from _by_calls(subject, unit, library, folder, states, what)
    yield from _by_fmpy(subject, unit, folder, states, what == "binary")


def _by_calls(
    subject: Identified, unit: Unpacked, library: Path, folder: Path, states: StateSet, what: str
) -> Iterator[Reloaded]:
    """Return torques by Co-Simulation, and the sum of their parts by Model Exchange."""
    kinds, rows = _inputs(states)
    size, expected = subject.model.robot.dof, subject.model.torque(states.motion, subject.theta)
    for exchange, asked in ((False, ("tau",)), (True, PARTS)):
        task, given, taken = folder / "unit.json", folder / "unit_states.bin", folder / "unit_torques.bin"
        facts = {"library": str(library), "token": unit.token, "exchange": exchange}
        facts |= {"inputs": unit.of(kinds, size), "outputs": unit.of(asked, size)}
        task.write_text(json.dumps(facts), encoding="utf-8", newline="\n")
        np.ascontiguousarray(rows, dtype=np.float64).tofile(given)
        command = [sys.executable, "-I", fmu_caller.__file__, str(task), str(given), str(taken)]
        found = subprocess.run(command, capture_output=True, timeout=PATIENCE, check=False)
        if found.returncode:
            told = found.stderr.decode("utf-8", "replace").strip().rsplit("\n", 1)[-1][:200]
            raise ValueError(f"its library ends with {found.returncode}: {told}")
        torque = np.fromfile(taken).reshape(len(rows), len(asked), size).sum(axis=1)
        told = f"{what}, Model Exchange, sum of the parts" if exchange else f"{what}, Co-Simulation, torque"
        yield Reloaded("calls by FMI 3.0", told, torque, expected)


def _by_fmpy(subject: Identified, unit: Unpacked, folder: Path, states: StateSet, binary: bool) -> Iterator[Reloaded]:
    """Have FMPy check the unit against the standard's schema and rules, and simulate it."""
    if find_spec("fmpy") is None:
        yield Reloaded("FMPy", why_not="not installed")
        return
    fmpy: Any = importlib.import_module("fmpy")
    problems = importlib.import_module("fmpy.validation").validate_fmu(str(unit.folder))
    if problems:
        raise ValueError(f"FMPy finds: {problems[0]}")
    if not binary:
        yield Reloaded(f"FMPy {fmpy.__version__}", why_not="it is valid; without a binary it is not simulated")
        return
    slave: Any = importlib.import_module("fmpy.fmi3").FMU3Slave(
        guid=unit.token, unzipDirectory=str(unit.folder), modelIdentifier=unit.identifier, instanceName="arm"
    )
    kinds, rows = _inputs(states)
    size = subject.model.robot.dof
    inputs, outputs = unit.of(kinds, size), unit.of(("tau",), size)
    slave.instantiate()
    try:
        slave.enterInitializationMode(startTime=0.0)
        slave.exitInitializationMode()
        found = np.empty((len(rows), size))
        for k, row in enumerate(rows.tolist()):
            slave.setFloat64(inputs, row)
            slave.doStep(currentCommunicationPoint=0.001 * k, communicationStepSize=0.001)
            found[k] = slave.getFloat64(outputs)
        slave.terminate()
    finally:
        slave.freeInstance()
    expected = subject.model.torque(states.motion, subject.theta)
    yield Reloaded(f"FMPy {fmpy.__version__}", "valid; Co-Simulation, torque", found, expected)


def _inputs(states: StateSet) -> tuple[tuple[str, ...], Array]:
    """Return the kinds of inputs and their values, a row a state."""
    motion = states.motion
    kinds = {"q": motion.q, "dq": motion.dq, "ddq": motion.ddq}
    if motion.temperature is not None:
        kinds["temperature"] = motion.temperature
    return tuple(kinds), np.hstack(list(kinds.values()))
