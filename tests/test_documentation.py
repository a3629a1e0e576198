"""README and docs are true: their blocks run, and their tables of keys and parts are complete.

Blocks that are marked in the line of the three backticks are run in a folder with a robot and two logs, page by page:
``python run`` in one namespace per page, ``console run`` with its output compared (``...`` is anything), ``yaml case``
read as a case, ``yaml robot`` as a robot, ``yaml refused`` compared with the message in the block after it.
``console run battery`` and ``python run battery`` are left to `make test-all`, ``console real`` needs the folder of
DYNIDENT_DATA. A comment
``<!-- run with: OPTIONS -->`` before a block makes its commands short, ``<!-- run before: COMMAND -->`` prepares them.
``python tests/test_documentation.py`` writes the generated tables of docs/ anew.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import itertools
import json
import os
import re
import shlex
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import dynident
from dynident.api.estimate_output import summary
from dynident.cli.main import main
from dynident.data.formats._units import UNITS
from dynident.data.preprocessing import FILTERS
from dynident.errors import DescriptionError, DynidentError
from dynident.exports.models import MODEL_EXPORTERS
from dynident.exports.motions import MOTION_EXPORTERS
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.fit import fit
from dynident.identification.uncertainty.trust import TrustOptions
from dynident.identification.validate import validate
from dynident.model.friction import FRICTION, Motion
from dynident.model.inertia import Inertia
from dynident.plugins import Family
from dynident.studies.comparison.difference_page import difference
from two_joint_arm import URDF

ROOT = Path(__file__).resolve().parent.parent
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
GENERATED: dict[str, Family[Any]] = {"friction": FRICTION, "filters": FILTERS, "estimators": ESTIMATORS}
EXPORTERS: dict[str, Family[Any]] = {"MOTION_EXPORTERS": MOTION_EXPORTERS, "MODEL_EXPORTERS": MODEL_EXPORTERS}
WITH_TABLES = ("case-file.md", "exports.md", "model-exports.md")


@dataclass(frozen=True)
class Block:
    """A fenced block of a page: language, marks after it, text, and the line where it begins."""

    page: Path
    line: int
    language: str
    marks: tuple[str, ...]
    text: str

    @property
    def place(self) -> str:
        return f"{self.page.name}:{self.line}"

    def remark(self, word: str) -> list[str]:
        """Return the words of the comment ``<!-- WORD: ... -->`` that stands right before the block."""
        before = self.page.read_text(encoding="utf-8").splitlines()[: self.line - 1]
        last = next((line for line in reversed(before) if line.strip()), "")
        found = re.fullmatch(rf"<!-- {word}: (.*) -->", last)
        return shlex.split(found[1]) if found else []


def blocks_of(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    found = []
    for match in re.finditer(r"^```([^\n`]*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        language, *marks = match[1].split() or [""]
        found.append(Block(page, text[: match.start()].count("\n") + 1, language, tuple(marks), match[2]))
    return found


def rows_after(page: str, mark: str) -> list[list[str]]:
    """Return the cells of the table that follows ``<!-- mark -->`` on a page of docs, without its head."""
    _, found, rest = (ROOT / "docs" / page).read_text(encoding="utf-8").partition(f"<!-- {mark} -->")
    assert found, f"{page} has no <!-- {mark} -->"
    lines = itertools.takewhile(lambda line: line.startswith("|"), rest.strip().splitlines())
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines][2:]


def names_in(rows: list[list[str]]) -> list[str]:
    """Return the first cells of table rows, without their backticks."""
    return [row[0].strip("`") for row in rows]


@pytest.fixture(scope="module")
def material(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a robot, two logs of its true model with noise, and a log without torques."""
    folder = tmp_path_factory.mktemp("material")
    (folder / "robot.urdf").write_text(URDF)
    robot = dynident.read_robot(folder / "robot.urdf")
    model = dynident.DynamicModel(robot, ("coulomb", "viscous", "offset"))  # type: ignore[arg-type]
    upper = Inertia.from_centre_of_mass(8.0, [0.2, 0.01, 0.0], np.diag([0.03, 0.15, 0.15]))
    fore = Inertia.from_centre_of_mass(3.5, [0.15, 0.0, 0.02], np.diag([0.01, 0.04, 0.04]))
    theta = np.r_[upper.vector, fore.vector, [4.0, 3.0, 0.5], [2.0, 1.5, -0.4]]
    for seed, name in enumerate(("run.csv", "other-run.csv")):
        generator = np.random.default_rng(seed)
        series = [generator.uniform(-0.4, 0.4, shape) for shape in (2, (2, 4), (2, 4))]
        time = np.arange(0, 16, 0.005)
        q, dq, ddq = dynident.FourierSeries(*series, period=8.0).evaluate(time)
        torque = model.torque(Motion(q, dq, ddq), theta) + generator.normal(0, 0.5, q.shape)
        noise = generator.normal(0, 2e-5, q.shape)
        dynident.write_log(dynident.Log(robot.joint_names, time, q + noise, torque=torque), folder / name)
    shutil.copytree(ROOT / "examples" / "servo_arm", folder / "examples" / "servo_arm")
    lines = [line.rsplit(",", 2)[0] for line in (folder / "run.csv").read_text().splitlines()[:100]]
    (folder / "no-torque.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture
def workshop(material: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a fresh copy of the material, the working directory of the test."""
    shutil.copytree(material, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


# --- pages run -------------------------------------------------------------------------------------------------------


def _name(page: Path) -> str:
    return page.stem if page.parent.name in ("docs", ROOT.name) else f"{page.parent.name}-{page.stem}"


def _pages_with(*marks: str) -> list[Path]:
    return [page for page in PAGES if any(set(marks) <= {block.language, *block.marks} for block in blocks_of(page))]


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_the_marked_blocks_of_a_page_run(page: Path, workshop: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every block that is marked runs, in order, and shows what the page shows."""
    blocks = [block for block in blocks_of(page) if "battery" not in block.marks]
    namespace: dict[str, Any] = {"__name__": "page"}
    for block, after in itertools.pairwise([*blocks, Block(page, 0, "", (), "")]):
        if block.language == "python" and "run" in block.marks:
            _run_python(block, namespace)
        elif block.language == "console" and "run" in block.marks:
            _run_console(block)
        elif block.language == "python" and block.marks:
            _install_part(block, workshop, monkeypatch)
        elif block.language == "yaml":
            _read_yaml(block, after, workshop)


@pytest.mark.battery
@pytest.mark.parametrize("page", _pages_with("console", "battery"), ids=_name)
def test_the_long_blocks_of_a_page_run(page: Path, workshop: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks marked ``battery`` run and show what the page shows; all that run, where Python is among them."""
    monkeypatch.delenv("DYNIDENT_DATA", raising=False)  # with real logs the demo takes a real arm
    blocks = blocks_of(page)
    python = [block for block in blocks if block.language == "python" and "battery" in block.marks]
    for block in blocks:
        if block in python:
            _run_python(block, {"__name__": "page"})
        elif block.language == "console" and ({"run"} if python else {"run", "battery"}) <= set(block.marks):
            _run_console(block)


@pytest.mark.battery
@pytest.mark.parametrize("page", _pages_with("console", "real"), ids=_name)
def test_the_blocks_on_real_logs_run(page: Path, workshop: Path) -> None:
    """Blocks marked ``real`` run where the data are, and show what the page shows."""
    if not Path(os.environ.get("DYNIDENT_DATA") or "no such folder").is_dir():
        pytest.skip("DYNIDENT_DATA names no folder with the real logs")
    shutil.copytree(ROOT / "examples" / "cases", workshop / "examples" / "cases")
    for block in blocks_of(page):
        if block.language == "console" and "real" in block.marks:
            _run_console(block)


def _run_python(block: Block, namespace: dict[str, Any]) -> None:
    source = "\n" * block.line + block.text  # so that a traceback names the line of the page
    with contextlib.redirect_stdout(io.StringIO()):
        exec(compile(source, str(block.page), "exec", dont_inherit=True), namespace)


def _run_console(block: Block) -> None:
    if before := block.remark("run before"):
        with contextlib.redirect_stdout(io.StringIO()):
            assert main(before) == 0
    for part in re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]:
        command, _, expected = part.partition("\n")
        program, *arguments = shlex.split(command)
        if program == "export":  # the test has a folder of its own
            continue
        assert Path(program).name == "dynident", f"{block.place}: {command}"
        shown, said = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(shown), contextlib.redirect_stderr(said):
            code = main([*arguments, *block.remark("run with")])
        output = shown.getvalue() + said.getvalue()
        assert code == ("error:" in expected), f"{block.place}: {command}\n{output}"
        assert _matches(expected, output), f"{block.place}: {command}\nexpected:\n{expected}\ngot:\n{output}"


def _matches(expected: str, output: str) -> bool:
    """Compare word by word: ``...`` is anything, ``word...`` a beginning, numbers may differ in their last digit."""
    parts = [list(group) for wild, group in itertools.groupby(expected.split(), "...".__eq__) if not wild]
    words = expected.split()
    got, place = output.split(), 0
    for number, part in enumerate(parts):
        last = number == len(parts) - 1 and words[-1] != "..."
        first = number == 0 and words[0] != "..."
        starts = [place] if first else range(place, len(got))
        starts = [len(got) - len(part)] if last and not first else starts
        found = next((s for s in starts if s >= place and _same_words(part, got[s : s + len(part)])), None)
        if found is None:
            return False
        place = found + len(part)
    return place == len(got) or not words or words[-1] == "..."


def _same_words(expected: Sequence[str], got: Sequence[str]) -> bool:
    return len(expected) == len(got) and all(map(_same_word, expected, got))


def _same_word(expected: str, got: str) -> bool:
    if expected == got or (expected.endswith("...") and got.startswith(expected[:-3])):
        return True
    if not re.fullmatch(r"-?\d+\.\d+", expected) or not re.fullmatch(r"-?\d+(\.\d+)?", got):
        return False
    return abs(float(expected) - float(got)) <= 1.01 * 10.0 ** -len(expected.partition(".")[2])


def _install_part(block: Block, workshop: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put the part that a page shows into its family, as if the file stood in the folder."""
    name = block.marks[0].removeprefix("part=")
    folder = workshop / "parts"
    folder.mkdir()
    (folder / f"{name}.py").write_text(block.text)
    package = importlib.import_module(FRICTION.package)
    monkeypatch.setattr(package, "__path__", [*package.__path__, str(folder)])
    monkeypatch.setattr(package, name, None, raising=False)  # the import below leaves nothing behind
    specification = spec_from_file_location(f"{FRICTION.package}.{name}", folder / f"{name}.py")
    assert specification and specification.loader
    module = module_from_spec(specification)
    monkeypatch.setitem(importlib.import_module("sys").modules, module.__name__, module)
    specification.loader.exec_module(module)


def _read_yaml(block: Block, after: Block, workshop: Path) -> None:
    file = workshop / "case.yaml"
    if "case" in block.marks:
        file.write_text(block.text)
        case = dynident.read_case(file)
        ESTIMATORS.make_from_text(case.estimator.name, case.estimator.options)
        if "defaults" in block.marks:
            plain = dynident.read_case(workshop / "robot.urdf")
            for name in ("friction", "columns", "preprocessing", "estimator", "train", "test", "split"):
                assert getattr(case, name) == getattr(plain, name), f"{block.place}: {name}"
    elif "robot" in block.marks:
        (workshop / "table.yaml").write_text(block.text)
        assert dynident.read_robot(workshop / "table.yaml").dof > 0
    elif "refused" in block.marks:
        file.write_text(block.text)
        with pytest.raises(DynidentError) as caught:
            dynident.read_case("case.yaml")
        assert after.language == "text", f"{block.place}: a refused case is followed by its message"
        assert _matches(after.text, str(caught.value)), f"{block.place}: {caught.value}"


def test_the_ten_tasks_take_three_lines_each() -> None:
    """Each heading of the page has one cell that runs, of at most three lines."""
    page = ROOT / "docs" / "notebooks" / "ten-tasks.md"
    parts = page.read_text(encoding="utf-8").split("\n## ")
    assert [part.partition(".")[0] for part in parts[1:]] == [str(k) for k in range(1, 11)]
    for part, block in zip(parts[1:], blocks_of(page)[1:], strict=True):
        assert block.text in part and (block.language, block.marks) == ("python", ("run",))
        assert len(block.text.splitlines()) <= 3, part.partition("\n")[0]


# --- the case file ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "path",
    [
        ".",
        "drives.shoulder",
        "limits",
        "log",
        "log.columns",
        "log.units",
        "preprocessing",
        "servo",
        "workspace",
        "constraints",
        "constraints.links.upper",
    ],
)
def test_every_key_of_the_case_file_is_documented(path: str, workshop: Path) -> None:
    """The keys in a table are those that the reader names when it meets one that it does not know."""
    document: dict[str, Any] = {"case": "1", "robot": "robot.urdf"}
    inner = document
    for key in path.split(".") if path != "." else []:
        inner = inner.setdefault(key, {})
    inner["no such key"] = "1"
    (workshop / "case.yaml").write_text(yaml.safe_dump(document))
    with pytest.raises(DescriptionError) as caught:
        dynident.read_case("case.yaml")
    known = re.search(r"known keys: ([^;]*)", str(caught.value))
    assert known and names_in(rows_after("case-file.md", f"keys: {path}")) == known[1].split(", ")


def test_the_words_of_units_are_those_of_the_reader() -> None:
    """Every unit word of every quantity, in order."""
    for name, words, _ in rows_after("case-file.md", "keys: log.units"):
        assert re.findall(r"`([^`]*)`", words) == list(UNITS[name.strip("`")])


def generated_table(family: Family[Any]) -> str:
    """Return the table of the parts of a family with their options, from their docstrings."""
    lines = ["| part | option | type | default | what it is |", "|---|---|---|---|---|"]
    shared = [field.name for field in fields(family.kind)] if is_dataclass(family.kind) else []
    for name in [*(["every part"] if shared else []), *family.names()]:
        every = name == "every part"
        rows = [("", "", "", "" if every else family.summary(name))]
        options = family.options(family.names()[0] if every else name)
        wanted = [option for option in options if (option.name in shared) == every]
        rows += [(f"`{o.name}`", f"`{o.kind}`", f"`{_written(o.default)}`", o.help) for o in wanted]
        for number, cells in enumerate(rows):
            safe = [cell.replace("``", "`").replace("|", r"\|") for cell in cells]
            first = ("every part" if every else f"`{name}`") * (number == 0)
            lines.append("|" + "".join(f" {cell}".rstrip() + " |" for cell in [first, *safe]))
    return "\n".join(lines)


def _written(value: object) -> str:
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    return f"{value:g}" if isinstance(value, float) else str(value)


def proofs_table(family: Family[Any]) -> str:
    """Return the table of what each exporter writes, needs, and has compared, from its class variables."""
    lines = ["| target | file | needs | compared when it is loaded again |", "|---|---|---|---|"]
    for name in family.names():
        part = family.get(name)
        file = "a folder" if part.writes_folder else f"`{part.suffix}`"
        needs = f"`pip install 'dynident[{part.extra}]'`" if part.extra else ""
        lines.append("|" + "".join(f" {cell}".rstrip() + " |" for cell in (f"`{name}`", file, needs, part.proof)))
    return "\n".join(lines)


def with_generated_tables(text: str) -> str:
    """Return a page with the tables between its marks written anew."""
    tables = {name: generated_table(family) for name, family in GENERATED.items()}
    tables |= {f"proofs of {name}": proofs_table(family) for name, family in EXPORTERS.items()}
    for name, table in tables.items():
        begin, end = f"<!-- generated: {name} -->\n", "<!-- generated: end -->"
        head, found, rest = text.partition(begin)
        _, _, tail = rest.partition(end)
        text = f"{head}{begin}\n{table}\n\n{end}{tail}" if found else text
    return text


@pytest.mark.parametrize("page", WITH_TABLES)
def test_the_generated_tables_are_those_of_the_parts(page: str) -> None:
    """A part that is new, gone or changed shows on the page."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    assert text.count("<!-- generated: ") == 2 * (len(GENERATED) if page == "case-file.md" else 1)
    assert text == with_generated_tables(text), "run: python tests/test_documentation.py"


# --- the JSON --------------------------------------------------------------------------------------------------------


def keys_of(value: Any, path: str = "") -> Iterator[str]:
    """Yield the key path of everything in plain data; ``[]`` stands for each item of a list."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from keys_of(inner, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        inside = [key for item in value for key in keys_of(item, f"{path}[]")]
        yield from inside or [f"{path}[]"]
    else:
        yield path


STANDARD = ("name", "value", "std", "unit", "verdict", "label", "data_share", "range")


def test_every_key_of_the_json_is_documented(workshop: Path) -> None:
    """The documented keys are the produced ones, for every estimator."""
    case = dynident.read_case("robot.urdf")
    train, test = case.read("run.csv").split(0.6)
    problem = build_problem(case.model, [train], case.preprocessing)
    tables = {name: rows_after("json-output.md", f"json: {name}") for name in ("estimate", "figures", "extras")}
    for name in ESTIMATORS.names():
        part = ESTIMATORS.make(name)
        estimate = fit(problem, replace(part, bodies="free") if isinstance(part, Consistent) else part)
        produced = summary(estimate, validate(estimate, [test]))
        figures = set(names_in(tables["figures"]))
        assert set(keys_of(produced["test"])) == figures
        assert set(keys_of(produced["train"])) - {"bands[]"} == {key for key in figures if not key.startswith("bands")}
        mine = {row[0].strip("`") for row in tables["extras"] if row[1] == "all" or name in row[1].split(", ")}
        settings = {"settings": None} if "settings" in produced["extras"] else {}
        assert set(keys_of(produced["extras"] | settings)) == mine
        assert set(produced["options"]) == {option.name for option in ESTIMATORS.options(name)}
        if name == "wls":
            beside = difference([estimate, estimate], ["a", "b"]).figures()
            documented = {row[0].strip("`") for row in rows_after("json-output.md", "json: diff")}
            assert set(keys_of(beside)) | {"only_in"} == documented
        folded = ("options", "filter", "extras", "train", "test", "extrapolation", "diagnostics", "verdict")
        nested = {key: None for key in folded}
        links = {name for name in names_in(tables["estimate"]) if name.startswith("links[]")}
        assert set(keys_of({"links": produced.pop("links")})) == links or produced["standard_parameters"] is None
        standard = {f"standard_parameters[].{key}" for key in STANDARD}
        if produced["standard_parameters"] is None:
            produced["standard_parameters"] = [dict.fromkeys(STANDARD)]
        assert standard <= set(names_in(tables["estimate"]))
        produced["inconsistencies"], produced["degrees_of_freedom"] = [], []
        assert sorted({*keys_of(produced | nested), *links}) == sorted(names_in(tables["estimate"]))


def test_every_key_of_trust_is_documented(workshop: Path) -> None:
    """Extrapolation of a test, and diagnostics with a bootstrap."""
    case = dynident.read_case("robot.urdf")
    train, test = case.read("run.csv").split(0.6)
    estimate = dynident.identify(
        case.model, [train], preprocessing=case.preprocessing, trust=TrustOptions(diagnose=True, bootstrap=40)
    )
    produced = summary(estimate, validate(estimate, [test]))
    of_temperatures = {"joints[].temperature"}  # of models and logs that have them
    for name in ("extrapolation", "diagnostics"):
        documented = set(names_in(rows_after("json-output.md", f"json: {name}")))
        assert set(keys_of(produced[name])) == documented - of_temperatures


def _no_such_number(word: str) -> None:
    raise AssertionError(f"{word} is no JSON")


def test_both_commands_print_one_object_with_the_documented_keys(
    workshop: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """``identify --json`` and ``validate --json`` print JSON and nothing else, with the same keys."""
    keys = names_in(rows_after("json-output.md", "json: estimate"))
    documented = {key.split(".")[0].removesuffix("[]") for key in keys}
    options = ["robot.urdf", "run.csv", "--split", "first:0.6", "-o", "estimate.json", "--json"]
    for arguments in (["identify", *options], ["validate", "estimate.json", "other-run.csv", "--json"]):
        assert main(arguments) == 0
        shown = capsys.readouterr()
        printed = json.loads(shown.out, parse_constant=_no_such_number)
        assert set(printed) == {"schema", *documented} and printed["schema"] == 2
        nominal = printed["test"].pop("nominal")
        assert printed["test"].pop("free_bodies_error") > 0.0
        assert set(keys_of(nominal)) == set(names_in(rows_after("json-output.md", "json: nominal")))
        assert set(keys_of(printed["test"])) == set(names_in(rows_after("json-output.md", "json: figures")))
        verdict = {name.split(".")[0] for name in names_in(rows_after("json-output.md", "json: verdict"))}
        printed_keys = {key + "[]" * isinstance(value, list) for key, value in printed["verdict"].items()}
        assert printed_keys | {"new_log"} == verdict and ("new_log" in printed_keys) == (arguments[0] == "validate")
        assert shown.err == ""


def test_every_key_of_the_filter_statement_is_documented() -> None:
    """The documented keys are the produced ones, for every filter."""
    rows = rows_after("json-output.md", "json: filter")
    for name in FILTERS.names():
        stated = dynident.Preprocessing(FILTERS.make(name)).statement()
        assert set(stated) == {row[0].strip("`") for row in rows if row[1] == "all" or name in row[1].split(", ")}


# --- choices ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", GENERATED)
def test_every_part_has_a_line_that_says_when_to_use_it(name: str) -> None:
    """The pages on the choice list exactly the parts that are there."""
    pages = {"friction": "which-friction-model.md", "filters": "which-filter.md", "estimators": "how-to-choose.md"}
    rows = rows_after(pages[name], f"parts: {name}")
    assert sorted(names_in(rows)) == list(GENERATED[name].names())
    assert all(all(row) for row in rows)


if __name__ == "__main__":
    for page in WITH_TABLES:
        place = ROOT / "docs" / page
        place.write_text(with_generated_tables(place.read_text(encoding="utf-8")), encoding="utf-8")
