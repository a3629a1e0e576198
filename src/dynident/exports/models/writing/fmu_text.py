"""An identified model -> a functional mock-up unit by FMI 3.0: description, sources, binary, archive.

Functions of the standard that a unit must have and has no use for are refused, in C.
"""

from __future__ import annotations

import hashlib
import io
import platform
import sys
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Final
from xml.sax.saxutils import quoteattr

from dynident.exports.c_compiler import Compiler, build_library
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import takes_time
from dynident.exports.models.writing.c_text import header_text
from dynident.exports.names_in_files import comment_text, shown_names, template_parts

#: Names of files in the archive.
DESCRIPTION, SOURCE, HEADER, MODEL = "modelDescription.xml", "fmi3.c", "dynamics.h", "resources/model.dynident.json"

#: Outputs: what each is, and the inputs that it depends on; where friction depends on the load, on all.
OUTPUTS: Final[Mapping[str, tuple[str, tuple[str, ...]]]] = {
    "tau": ("torque of the drive as identified, the sum of the next four", ("q", "dq", "ddq", "temperature")),
    "gravity": ("torque that holds the bodies against gravity", ("q",)),
    "coriolis": ("torque of speed alone, without friction", ("q", "dq")),
    "inertia": ("mass matrix times acceleration, rotors included", ("q", "ddq")),
    "friction": ("friction and offsets, less the bias of the drive", ("q", "dq", "temperature")),
    "feed_forward": ("torque of the drive with smooth signs of Coulomb friction", ("q", "dq", "ddq", "temperature")),
}

_INPUTS: Final = {"q": "position", "dq": "velocity", "ddq": "acceleration", "temperature": "temperature of the drive"}

_REVOLUTE: Final = {"q": "rad", "dq": "rad/s", "ddq": "rad/s2", "temperature": "degC"}
_SLIDING: Final = {"q": "m", "dq": "m/s", "ddq": "m/s2", "temperature": "degC"}

#: Units by name: exponents of SI units, and an offset.
_UNITS: Final = {
    "s": 's="1"',
    "rad": 'rad="1"',
    "rad/s": 'rad="1" s="-1"',
    "rad/s2": 'rad="1" s="-2"',
    "N.m": 'kg="1" m="2" s="-2"',
    "m": 'm="1"',
    "m/s": 'm="1" s="-1"',
    "m/s2": 'm="1" s="-2"',
    "N": 'kg="1" m="1" s="-2"',
    "degC": 'K="1" offset="273.15"',
}

#: Temperature in degrees Celsius that a unit begins with.
ROOM = 20.0

#: Every file of an archive has this date, the first that archives know: the same estimate gives the same bytes.
_DATE: Final = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class Variable:
    """A variable of a unit.

    Attributes:
        name: By the structured convention, such as ``q[1]``.
        reference: Its value reference.
        kind: ``q``, ``dq``, ``ddq``, ``temperature`` or an output.
        unit: Name of its unit.
        about: What it is, in words.
    """

    name: str
    reference: int
    kind: str
    unit: str
    about: str

    @property
    def is_input(self) -> bool:
        """Whether it is an input."""
        return self.kind in _INPUTS


def variables_of(subject: Identified) -> tuple[Variable, ...]:
    """Return the variables of a model: inputs by kind and joint, then outputs; value references run from 1 on."""
    robot, needs = subject.model.robot, subject.model.needs
    names = shown_names(robot.joint_names)[0]
    kinds = {kind: about for kind, about in _INPUTS.items() if kind != "temperature" or "temperature" in needs}
    kinds |= {kind: about for kind, (about, _) in OUTPUTS.items()}
    found: list[Variable] = []
    for kind, about in kinds.items():
        for i, (name, joint) in enumerate(zip(names, robot.active, strict=True), start=1):
            revolute = joint.kind != "prismatic"
            unit = (_REVOLUTE if revolute else _SLIDING).get(kind, "N.m" if revolute else "N")
            found.append(Variable(f"{kind}[{i}]", len(found) + 1, kind, unit, f"{name}: {about}"))
    return tuple(found)


def unit_files(subject: Identified, prefix: str, scale: float, document: bytes) -> dict[str, bytes]:
    """Return the files of a unit without binaries, by name in the archive.

    Args:
        subject: The model.
        prefix: Its model identifier, a C name.
        scale: Speed over which signs turn in the output ``feed_forward``, in rad/s or m/s.
        document: The model as JSON, kept among the resources.
    """
    header = header_text(subject, prefix, scale, regressor=False)
    variables = variables_of(subject)
    source = _source(subject, prefix, variables)
    facts = "".join((header, source, *(f"{v.name}{v.unit}{v.about}" for v in variables)))
    token = "{" + hashlib.sha256(facts.encode("ascii")).hexdigest() + "}"
    source = source.replace("@TOKEN@", token)
    return {
        DESCRIPTION: "\n".join([*_description(subject, prefix, token, variables), ""]).encode("ascii"),
        "sources/buildDescription.xml": _build(prefix).encode("ascii"),
        f"sources/{SOURCE}": source.encode("ascii"),
        f"sources/{HEADER}": header.encode("ascii"),
        MODEL: document,
    }


def archive(files: Mapping[str, bytes]) -> bytes:
    """Return files as one ZIP archive, in which nothing depends on the time or the machine."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as target:
        for name, data in files.items():
            entry = zipfile.ZipInfo(name, _DATE)
            entry.compress_type, entry.create_system = zipfile.ZIP_DEFLATED, 3
            entry.external_attr = 0o100644 << 16
            target.writestr(entry, data)
    return stream.getvalue()


def _source(subject: Identified, prefix: str, variables: tuple[Variable, ...]) -> str:
    warm = [v.reference for v in variables if v.kind == "temperature"]
    size = subject.model.robot.dof
    values = {
        "VERSION": version("dynident"),
        "HEADER": HEADER,
        "UPPER": prefix.upper(),
        "LOWER": prefix,
        "INPUTS": str(sum(v.is_input for v in variables) // size),
        "OUTPUTS": str(len(OUTPUTS)),
        "STARTS": "".join(f"    unit->value[{k}] = {ROOM!r};\n" for k in warm),
        "TEMPERATURE": "    const double *temperature = ddq + N;\n" if warm else "",
        "TEMP": "temperature, " if warm else "",
        **_memory(prefix, "state" in subject.model.needs, takes_time(subject.model)),
    }
    text = template_parts("fmi3.c")[0] + "\n".join(lacking_functions()) + "\n"
    for name, value in values.items():
        text = text.replace(f"@{name}@", value)
    return text


def _memory(prefix: str, remembers: bool, timed: bool) -> dict[str, str]:
    """Return what the source has of friction that remembers; all empty where none does.

    What is remembered moves on with each step that the simulator takes for good; torques between two steps follow from
    it and the positions alone. It begins at the positions of the initialization, where these were set there.
    """
    step, given = f"{prefix}_memory_step", "unit->mode & (BORN | INITIALIZATION)"
    since = ", unit->value[0] - unit->since" if timed else ""
    kept = f"{step}(&unit->memory, unit->value + 1{since});\n" + "    unit->since = unit->value[0];\n" * timed
    values = {
        "WAY": ", and what friction\n * remembers from the way of q",
        "MEMORY_FIELD": f"    {prefix}_memory memory;\n    bool placed;\n" + "    double since;\n" * timed,
        "MEMORY_RESET": f"    {prefix}_memory_reset(&unit->memory);\n    unit->placed = false;\n"
        + "    unit->since = 0.0;\n" * timed,
        "MEMORY_HERE": f"    {prefix}_memory memory = unit->memory;\n",
        "MEMORY_MOVE": f"    {step}(&memory, q{since});\n",
        "MEMORY": "&memory, ",
        "MEMORY_BEGIN": "    unit->since = unit->value[0];\n" * timed
        + f"    if (unit->placed) {{\n        {step}(&unit->memory, unit->value + 1{since});\n    }}\n",
        "MEMORY_BACK": "    unit->memory = kept->memory;\n    unit->placed = kept->placed;\n"
        + "    unit->since = kept->since;\n" * timed,
        "PLACED": f"        unit->placed |= references[k] <= N && ({given});\n",
        "UNIT": "    Unit *unit = instance;\n",
        "KEPT": f"    {kept}",
        "KEPT_BY_STEP": f"    {kept}",
    }
    return {name: text if remembers else "" for name, text in values.items()}


def _description(subject: Identified, prefix: str, token: str, variables: tuple[Variable, ...]) -> Iterator[str]:
    model = subject.model
    facts = {
        "fmiVersion": "3.0",
        "modelName": shown_names((model.robot.name,))[0][0],
        "instantiationToken": token,
        "description": comment_text(
            f"inverse dynamics of an identified robot arm, method {subject.estimate.estimator}, standard parameters: "
            f"{subject.origin}"
        ),
        "generationTool": f"dynident {version('dynident')}",
        "variableNamingConvention": "structured",
    }
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield f"<fmiModelDescription {_attributes(facts)}>"
    called = ' needsCompletedIntegratorStep="true"' if "state" in model.needs else ""
    yield f'  <ModelExchange modelIdentifier="{prefix}" canGetAndSetFMUState="true"{called}/>'
    able = 'canGetAndSetFMUState="true" canHandleVariableCommunicationStepSize="true"'
    yield f'  <CoSimulation modelIdentifier="{prefix}" {able}/>'
    yield "  <UnitDefinitions>"
    used = {"s", *(v.unit for v in variables)}
    for name, base in _UNITS.items():
        if name in used:
            yield f'    <Unit name="{name}"><BaseUnit {base}/></Unit>'
    yield "  </UnitDefinitions>"
    yield '  <LogCategories><Category name="logStatusError" description="calls that were refused"/></LogCategories>'
    yield '  <DefaultExperiment startTime="0" stopTime="1" stepSize="0.001"/>'
    yield "  <ModelVariables>"
    yield '    <Float64 name="time" valueReference="0" causality="independent" variability="continuous" unit="s"/>'
    yield from (f"    <Float64 {_attributes(_facts(v))}/>" for v in variables)
    yield "  </ModelVariables>"
    yield "  <ModelStructure>"
    unknown = [(v.reference, _depends(subject, v, variables)) for v in variables if not v.is_input]
    for element in ("Output", "InitialUnknown"):
        yield from (f'    <{element} valueReference="{k}" dependencies="{of}"/>' for k, of in unknown)
    yield "  </ModelStructure>"
    yield "</fmiModelDescription>"


def _facts(variable: Variable) -> dict[str, str]:
    own = {"name": variable.name, "valueReference": str(variable.reference)}
    if variable.is_input:
        start = ROOM if variable.kind == "temperature" else 0.0
        own |= {"causality": "input", "variability": "continuous", "start": repr(start)}
    else:
        own |= {"causality": "output", "variability": "continuous", "initial": "calculated"}
    return own | {"unit": variable.unit, "description": variable.about}


def _depends(subject: Identified, variable: Variable, variables: tuple[Variable, ...]) -> str:
    """Return the value references of the inputs that an output depends on."""
    every = variable.kind == "friction" and "torque" in subject.model.needs
    kinds = tuple(_INPUTS) if every else OUTPUTS[variable.kind][1]
    return " ".join(str(v.reference) for v in variables if v.is_input and v.kind in kinds)


def _attributes(facts: Mapping[str, str]) -> str:
    return " ".join(f"{name}={quoteattr(value)}" for name, value in facts.items())


def _build(prefix: str) -> str:
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<fmiBuildDescription fmiVersion="3.0">\n'
        f'  <BuildConfiguration modelIdentifier="{prefix}">\n'
        f'    <SourceFileSet language="C99"><SourceFile name="{SOURCE}"/></SourceFileSet>\n'
        "  </BuildConfiguration>\n"
        "</fmiBuildDescription>\n"
    )


_SYSTEMS: Final = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("windows", ".dll")}
_MACHINES: Final = {"x86_64": "x86_64", "amd64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}


def platform_tuple() -> tuple[str, str]:
    """Return this machine's name in FMI 3.0 and the end of the names of its libraries; empty where it has none."""
    system, suffix = _SYSTEMS.get(sys.platform, ("", ""))
    machine = _MACHINES.get(platform.machine().lower(), "")
    return (f"{machine}-{system}", suffix) if system and machine and sys.maxsize > 2**32 else ("", "")


def built(files: dict[str, bytes], identifier: str, folder: Path, compiler: Compiler) -> dict[str, bytes]:
    """Return the library of a unit for this machine, by its name in the archive.

    Args:
        files: The files of the unit.
        identifier: Its model identifier.
        folder: An empty folder.
        compiler: The C compiler.

    Raises:
        NoCompilerRuns: The compiler builds nothing here.
        ValueError: It refuses the sources.
    """
    name, suffix = platform_tuple()
    for file, data in files.items():
        if file.startswith("sources/"):
            (folder / Path(file).name).write_bytes(data)
    library = f"{identifier}{suffix}"
    build_library(compiler, folder, SOURCE, library)
    return {f"binaries/{name}/{library}": (folder / library).read_bytes()}


#: Types of which the unit has no variable.
_OTHERS: Final = (
    "Float32",
    "Int8",
    "UInt8",
    "Int16",
    "UInt16",
    "Int32",
    "UInt32",
    "Int64",
    "UInt64",
    "Boolean",
    "String",
)

_WHICH: Final = ("const fmi3ValueReference {}[]", "size_t {}")
_BINARY: Final = ("const fmi3Binary {}[]", "size_t {}")
_SLOPE: Final = (*_WHICH, *_WHICH, "const fmi3Float64 {}[]", "size_t {}", "fmi3Float64 {}[]", "size_t {}")
_FRACTION: Final = ("fmi3UInt64 {}[]", "fmi3UInt64 {}[]")
_FIXED_FRACTION: Final = ("const fmi3UInt64 {}[]", "const fmi3UInt64 {}[]")
_STATES: Final = ("fmi3Float64 {}[]", "size_t {}")

#: Refused whatever is asked; the parameters behind the instance.
_ALWAYS: Final[dict[str, Sequence[str]]] = {
    "GetNumberOfVariableDependencies": ("fmi3ValueReference {}", "size_t *{}"),
    "GetVariableDependencies": (
        "fmi3ValueReference {}",
        "size_t {}[]",
        "fmi3ValueReference {}[]",
        "size_t {}[]",
        "fmi3DependencyKind {}[]",
        "size_t {}",
    ),
    "SerializedFMUStateSize": ("fmi3FMUState {}", "size_t *{}"),
    "SerializeFMUState": ("fmi3FMUState {}", "fmi3Byte {}[]", "size_t {}"),
    "DeserializeFMUState": ("const fmi3Byte {}[]", "size_t {}", "fmi3FMUState *{}"),
    "GetDirectionalDerivative": _SLOPE,
    "GetAdjointDerivative": _SLOPE,
    "EnterConfigurationMode": (),
    "ExitConfigurationMode": (),
    "EnterStepMode": (),
    "ActivateModelPartition": ("fmi3ValueReference {}", "fmi3Float64 {}"),
}

#: Refused where they are asked for something; the second parameter behind the instance says for how many.
_SOMETHING: Final[dict[str, Sequence[str]]] = {
    **{f"Get{kind}": (*_WHICH, f"fmi3{kind} {{}}[]", "size_t {}") for kind in _OTHERS},
    **{f"Set{kind}": (*_WHICH, f"const fmi3{kind} {{}}[]", "size_t {}") for kind in _OTHERS},
    "GetBinary": (*_WHICH, "size_t {}[]", "fmi3Binary {}[]", "size_t {}"),
    "SetBinary": (*_WHICH, "const size_t {}[]", *_BINARY),
    "GetClock": (*_WHICH, "fmi3Clock {}[]"),
    "SetClock": (*_WHICH, "const fmi3Clock {}[]"),
    "GetIntervalDecimal": (*_WHICH, "fmi3Float64 {}[]", "fmi3IntervalQualifier {}[]"),
    "GetIntervalFraction": (*_WHICH, *_FRACTION, "fmi3IntervalQualifier {}[]"),
    "GetShiftDecimal": (*_WHICH, "fmi3Float64 {}[]"),
    "GetShiftFraction": (*_WHICH, *_FRACTION),
    "SetIntervalDecimal": (*_WHICH, "const fmi3Float64 {}[]"),
    "SetIntervalFraction": (*_WHICH, *_FIXED_FRACTION),
    "SetShiftDecimal": (*_WHICH, "const fmi3Float64 {}[]"),
    "SetShiftFraction": (*_WHICH, *_FIXED_FRACTION),
    "GetOutputDerivatives": (*_WHICH, "const fmi3Int32 {}[]", "fmi3Float64 {}[]", "size_t {}"),
    "SetContinuousStates": ("const fmi3Float64 {}[]", "size_t {}"),
    "GetContinuousStateDerivatives": _STATES,
    "GetEventIndicators": _STATES,
    "GetContinuousStates": _STATES,
    "GetNominalsOfContinuousStates": _STATES,
}

#: Numbers that are 0.
_ZERO: Final = ("GetNumberOfEventIndicators", "GetNumberOfContinuousStates")


def lacking_functions() -> Iterator[str]:
    """Yield the C source of these functions."""
    for name, parameters in _ALWAYS.items():
        yield _function(name, parameters, f'refused(unit, "this unit does not have {name}")')
    for name, parameters in _SOMETHING.items():
        yield _function(name, parameters, 'b ? refused(unit, "this unit has none of these") : fmi3OK')
    for name in _ZERO:
        yield _function(name, ("size_t *{}",), "fmi3OK", "    *a = 0;\n")


def _function(name: str, parameters: Sequence[str], answer: str, more: str = "") -> str:
    letters = "abcdefghi"[: len(parameters)]
    takes = ", ".join(["fmi3Instance unit", *(one.format(k) for one, k in zip(parameters, letters, strict=True))])
    unused = ", ".join(f"(void){letter}" for letter in ("unit", *letters))
    return f"\nSTATUS(fmi3{name})({takes})\n{{\n    {unused};\n{more}    return {answer};\n}}"
