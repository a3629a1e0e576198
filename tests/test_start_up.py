"""Nothing heavy is imported before it is needed: the front door and --help of every command stay light."""

from __future__ import annotations

import importlib
import io
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import dynident
from dynident.cli.main import COMMANDS, escape_unknown_characters, one_blas_thread_unless_stated
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.robot import Robot

HEAVY = ("numba", "llvmlite", "scipy", "matplotlib", "plotly", "rich", "clarabel", "jinja2", "yaml")

_LOADED = f"import sys; print([name for name in {HEAVY!r} if name in sys.modules])"


def _heavy_after(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", f"{code}\n{_LOADED}"], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()[-1]


def test_importing_the_package_is_light() -> None:
    assert _heavy_after("import dynident; dir(dynident); dynident.__version__") == "[]"


def test_help_of_every_command_is_light() -> None:
    code = "\n".join(
        [
            "import contextlib, io",
            "from dynident.cli.main import main",
            f"for words in {[[], *([name] for name in COMMANDS)]!r}:",
            "    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):",
            "        main([*words, '--help'])",
        ]
    )
    assert _heavy_after(code) == "[]"


def test_reading_xml_loads_nothing_of_the_network() -> None:
    code = "\n".join(
        [
            "import sys",
            "from dynident.robot_files.xml_elements import XmlLanguage, parse_xml",
            "assert parse_xml('', b'<robot/>', XmlLanguage('URDF', ('robot',), 'link')).tag == 'robot'",
            "print([name for name in ('ssl', 'urllib.request', 'defusedxml') if name in sys.modules])",
        ]
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


#: What takes as long to load as a small identification takes, each.
SLOW = ("numba", "scipy.stats", "scipy.signal", "scipy.optimize", "scipy.interpolate", "scipy.ndimage", "scipy.spatial")

#: What an identification alone does without besides: parts for few cases, and what has no place in one.
NOT_FOR_ALL = (
    "scipy.sparse", "scipy.linalg", "scipy.special", "defusedxml", "urllib.request", "ssl", "jinja2", "rich.markdown",
    "matplotlib", "dynident.robot_files.mjcf", "dynident.robot_files.usd_parts", "dynident.case.link_volume",
    "dynident.case.workspace_section",
    "dynident.case.draft", "dynident.data.formats._bag_table",
    "dynident.diagnosis.causes", "dynident.diagnosis.checks", "dynident.diagnosis.examination",
    "dynident.studies.benchmark",
    "dynident.identification.streaming",
    "dynident.identification.simulated.course", "dynident.simulation", "dynident.model.kernels.generic",
    "dynident.model.kernels.preconditioned", "dynident.results.report", "dynident.studio",
)  # fmt: skip


#: What a check alone does without besides.
NOT_FOR_CHECK = (
    "scipy.sparse", "scipy.linalg", "scipy.special", "urllib.request", "jinja2", "matplotlib",
    "dynident.robot_files.usd_parts", "dynident.case.link_volume", "dynident.case.workspace_section",
    "dynident.api.validate", "dynident.diagnosis.verdict", "dynident.identification.files",
    "dynident.identification.selection.friction.search_friction", "dynident.exports", "dynident.results.report",
)  # fmt: skip


def write_arm_and_log(tmp_path: Path, planar_2r: Robot, exact_log: Callable[..., Log]) -> None:
    model = DynamicModel(planar_2r, (FRICTION.make("viscous"),))
    assert planar_2r.nominal is not None
    log = exact_log(model, np.append(planar_2r.nominal, [0.3, 0.2]), noise=0.05, samples=1600, rate=200.0)
    write_log(Log(log.joints, log.time, log.q, torque=log.torque), tmp_path / "run.csv")
    (tmp_path / "arm.json").write_text(json.dumps(robot_to_dict(planar_2r)))


def test_the_usual_commands_load_nothing_slow(tmp_path: Path, planar_2r: Robot, exact_log: Callable[..., Log]) -> None:
    """From the robot model of an arm and its log to a report, in one process."""
    write_arm_and_log(tmp_path, planar_2r, exact_log)
    code = "\n".join(
        [
            "from dynident.cli.main import main",
            "for words in ('inspect arm.json', 'init arm.json run.csv -o case.yaml', 'check case.yaml',",
            "              'identify case.yaml -o estimate.json', 'validate estimate.json run.csv',",
            "              'report estimate.json -o report.html'):",
            "    assert main(words.split()) == 0, words",
            f"import sys; print([name for name in {SLOW!r} if name in sys.modules])",
        ]
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"
    for words, left_out in (
        (["identify", "case.yaml", "--no-check"], NOT_FOR_ALL),
        (["check", "case.yaml"], NOT_FOR_CHECK),
    ):
        alone = f"from dynident.cli.main import main; import sys; assert main({words!r}) == 0; "
        alone += f"print([name for name in {SLOW + left_out!r} if name in sys.modules])"
        done = subprocess.run([sys.executable, "-c", alone], capture_output=True, text=True, check=False, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert done.stdout.splitlines()[-1] == "[]"


def test_blas_works_on_one_thread_unless_stated_otherwise() -> None:
    empty: dict[str, str] = {}
    one_blas_thread_unless_stated(empty)
    assert empty == {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    stated = {"OMP_NUM_THREADS": "4"}
    one_blas_thread_unless_stated(stated)
    assert stated == {"OMP_NUM_THREADS": "4"}


def test_the_entry_point_exits_with_the_code() -> None:
    call = "import sys; from dynident.cli.main import entry_point; sys.argv = ['dynident', '--version']; entry_point()"
    done = subprocess.run([sys.executable, "-c", call], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, f"dynident {dynident.__version__}\n")


def _with_encoding(encoding: str, words: list[str], folder: Path) -> subprocess.CompletedProcess[bytes]:
    call = "from dynident.cli.main import entry_point; entry_point()"
    variables = {**os.environ, "PYTHONIOENCODING": encoding}
    command = [sys.executable, "-c", call, *words]
    return subprocess.run(command, capture_output=True, check=False, cwd=folder, env=variables)


def test_an_encoding_without_some_character(tmp_path: Path) -> None:
    done = _with_encoding("ascii", ["inspect", "generic-scara"], tmp_path)
    assert done.returncode == 0 and done.stderr == b""
    assert b"gravity (0, 0, -9.81) m/s\\xb2" in done.stdout


def test_what_a_user_states_for_unknown_characters_stays() -> None:
    for errors, expected in (("strict", b"\\xb2"), ("surrogateescape", b"\\xb2"), ("replace", b"?")):
        stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii", errors=errors)
        escape_unknown_characters(stream)
        stream.write("\xb2")
        stream.flush()
        assert stream.buffer.getvalue() == expected  # type: ignore[attr-defined]
    for other in (None, io.StringIO()):  # no standard output, one of another kind
        escape_unknown_characters(other)


@pytest.mark.battery
@pytest.mark.parametrize("encoding", ["cp1251", "cp932", "gbk", "ascii", "latin-1"])
def test_exit_code_and_files_do_not_depend_on_the_encoding(
    encoding: str, tmp_path: Path, planar_2r: Robot, exact_log: Callable[..., Log]
) -> None:
    write_arm_and_log(tmp_path, planar_2r, exact_log)
    answers = {}
    for name in ("utf-8", encoding):
        done = _with_encoding(name, "identify arm.json run.csv -o e.json --report e.html".split(), tmp_path)
        assert done.returncode == 0, done.stderr
        (tmp_path / "e.html").unlink()
        estimate = json.loads((tmp_path / "e.json").read_text("utf-8"))
        answers[name] = done.stdout.decode(name), estimate["theta"], estimate["covariance"], estimate["provenance"]
    ours, utf8 = answers[encoding], answers["utf-8"]
    assert ours[1:] == utf8[1:]
    assert ours[0].splitlines() == utf8[0].encode(encoding, "backslashreplace").decode(encoding).splitlines()


def test_every_name_at_the_front_door_is_there() -> None:
    names = [name for name in dir(dynident) if not name.startswith("_")]
    assert {"read_robot", "identify", "validate", "read_log", "write_report", "DynamicModel"} <= set(names)
    for name in names:
        assert getattr(dynident, name) is not None


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'dynident' has no attribute 'identfy'; did you mean 'identify'"):
        importlib.import_module("dynident").identfy
