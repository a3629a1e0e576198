"""A functional mock-up unit by FMI 3.0 for system simulators: inverse dynamics in C, sources and binary."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from dynident.errors import FileError
from dynident.exports.c_compiler import NoCompilerRuns, find_compiler
from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.proving.fmu_proof import proofs_of_unit
from dynident.exports.models.subject.drives import drives_of
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import StateSet
from dynident.exports.models.writing.c_text import check_names, prefix_of
from dynident.exports.models.writing.document import document_bytes
from dynident.exports.models.writing.fmu_text import archive, built, platform_tuple, unit_files


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
