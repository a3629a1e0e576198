"""Shell completion: the words that a shell offers are those that the parser takes."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from dynident.cli.completion import SHELLS, completion
from dynident.cli.main import COMMANDS, build_parser, main
from dynident.excitation.criteria import CRITERIA
from dynident.exports.motions import MOTION_EXPORTERS
from dynident.identification.estimators import ESTIMATORS


@pytest.fixture(scope="module")
def script() -> str:
    if shutil.which("bash") is None:
        pytest.skip("there is no bash to complete in")
    return completion(build_parser(), "bash")


def _offered(script: str, *words: str) -> set[str]:
    line = " ".join(f"'{word}'" for word in ("dynident", *words))
    ask = f"COMP_WORDS=({line}); COMP_CWORD={len(words)}; _dynident; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    done = subprocess.run(["bash", "-c", f"{script}\n{ask}"], capture_output=True, text=True, check=True, cwd="/")
    assert done.stderr == ""
    return set(done.stdout.split())


def test_bash_offers_commands_options_and_parts(script: str) -> None:
    assert _offered(script, "") == {*COMMANDS, "--help", "--version"}
    assert _offered(script, "ide") == {"identify"}
    assert _offered(script, "identify", "case.yaml", "--estimator", "") == set(ESTIMATORS.names())
    assert _offered(script, "compare", "--estimators", "c") == {n for n in ESTIMATORS.names() if n.startswith("c")}
    assert "all" in _offered(script, "compare", "--estimators", "")
    assert _offered(script, "excite", "er16", "--criterion", "") == set(CRITERIA.names())
    assert set(MOTION_EXPORTERS.names()) | {"urdf"} <= _offered(script, "export", "plan.json", "--to", "")
    assert "auto" in _offered(script, "identify", "case.yaml", "--friction", "")
    assert "auto" not in _offered(script, "excite", "case.yaml", "--friction", "")
    assert {"--port", "--work", "--no-browser"} <= _offered(script, "studio", "--")
    assert _offered(script, "studio", "--port", "--w") == {"--work"}
    assert _offered(script, "list", "estim") == {"estimators"}
    assert "er16" in _offered(script, "inspect", "er")


def test_bash_offers_files_where_files_go(script: str) -> None:
    assert "usr" in _offered(script, "report", "us") and "usr" in _offered(script, "report", "-o", "us")


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_the_other_shells_take_it(shell: str) -> None:
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"there is no {shell} to complete in")
    text = completion(build_parser(), shell)
    done = subprocess.run([program, "-n"], input=text, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("shell", SHELLS)
def test_every_option_of_every_command_is_there(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    text = capsys.readouterr().out
    for command in COMMANDS:
        assert command in text
    for option in ("--cross-validate", "--no-sensitivity", "--from-posture"):
        assert (f"-l {option[2:]}" if shell == "fish" else option) in text
