"""Nothing heavy is imported before it is needed: the front door and --help of every command stay light."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

import dynident
from dynident.cli.main import COMMANDS

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


def test_the_entry_point_exits_with_the_code() -> None:
    call = "import sys; from dynident.cli.main import entry_point; sys.argv = ['dynident', '--version']; entry_point()"
    done = subprocess.run([sys.executable, "-c", call], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, f"dynident {dynident.__version__}\n")


def test_every_name_at_the_front_door_is_there() -> None:
    names = [name for name in dir(dynident) if not name.startswith("_")]
    assert {"read_robot", "identify", "validate", "read_log", "write_report", "DynamicModel"} <= set(names)
    for name in names:
        assert getattr(dynident, name) is not None


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'dynident' has no attribute 'identfy'"):
        importlib.import_module("dynident").identfy
