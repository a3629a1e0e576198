"""``dynident environment`` says what is installed and from where, and names shadows, old packages and lost caches."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.cli import environment
from dynident.cli.main import main

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))


def _asked(**variables: str) -> tuple[int, dict[str, Any]]:
    """Run the command in a process of its own, as PYTHONPATH only works at the start."""
    code = "import sys; from dynident.cli.main import main; sys.exit(main(['environment', '--json']))"
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, check=False, env={**os.environ, **variables}
    )
    assert done.stderr == ""
    return done.returncode, json.loads(done.stdout)


@pytest.fixture(scope="module")
def facts() -> dict[str, Any]:
    return environment.environment()


def test_versions_and_places_are_those_of_the_imported_packages(facts: dict[str, Any]) -> None:
    assert facts["dynident"]["place"] == str(Path(environment.__file__).parents[1])
    packages = {one["name"]: one for one in facts["packages"]}
    assert set(packages) >= {"numpy", "scipy", "numba", "pyyaml", "threadpoolctl"}
    assert packages["numpy"]["version"] == np.__version__
    assert Path(packages["numpy"]["place"]) == Path(np.__file__)
    assert packages["pyyaml"]["place"].endswith(os.path.join("yaml", "__init__.py"))
    assert {pool["internal_api"] for pool in facts["threads"]["pools"]} & {"openblas", "mkl", "accelerate"}


def test_every_extra_of_the_project_is_explained() -> None:
    assert set(environment.EXTRAS) == set(PROJECT["project"]["optional-dependencies"])


def test_the_json_has_the_documented_keys(facts: dict[str, Any]) -> None:
    page = (Path(__file__).parents[2] / "docs" / "packaging.md").read_text(encoding="utf-8")
    table = page.partition("<!-- json: environment -->")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| `(\w+)` \| (.*) \|$", table, re.MULTILINE)
    assert [key for key, _ in rows] == list(facts)
    for key, text in rows:
        inner = facts[key][0] if isinstance(facts[key], list) and facts[key] else facts[key]
        if key not in ("variables", "findings") and inner:
            assert re.findall(r"`(\w+)`", text) == list(inner), key


def test_the_caches_are_where_numba_keeps_its_files(facts: dict[str, Any]) -> None:
    from dynident.model.kernels import generic_batches

    kept = [one for one in vars(generic_batches).values() if getattr(getattr(one, "_cache", None), "cache_path", None)]
    found = {folder: cache["place"] for cache in facts["caches"] for folder in cache["for"]}
    assert kept and {one._cache.cache_path for one in kept} == {found[os.path.join("model", "kernels")]}


def test_a_folder_for_all_caches_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = Path(environment.__file__)
    import numba

    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    place = environment.cache_place(source)
    assert place and tmp_path in Path(place).parents


def test_packages_of_another_python_on_the_path_are_named(tmp_path: Path) -> None:
    """What setup.bash of ROS does: a folder of another Python, with a numpy of its own, comes first."""
    folder = tmp_path / "opt" / "lib" / "python3.2" / "site-packages"
    (folder / "numpy").mkdir(parents=True)
    (folder / "numpy" / "__init__.py").write_text("")
    code, facts = _asked(PYTHONPATH=str(folder), DYNIDENT_KERNEL="fast", DYNIDENT_DATA=str(tmp_path / "none"))
    assert code == 1
    told = [f"{one['severity']}: {one['evidence']}; {one['step']}" for one in facts["findings"]]
    shadow = next(text for text in told if text.startswith("error: numpy is imported from"))
    assert str(folder / "numpy") in shadow and f"PYTHONPATH has {folder}" in shadow and "unset PYTHONPATH" in shadow
    assert any(text.startswith("warning: PYTHONPATH has packages of python3.2") for text in told)
    assert any(text.startswith("error: DYNIDENT_KERNEL is 'fast'") for text in told)
    assert any(text.startswith("warning: DYNIDENT_DATA names") for text in told)
    assert any("cannot be imported" in text for text in told), "the empty numpy breaks scipy, and that is said"
    assert facts["variables"]["DYNIDENT_KERNEL"] == "fast"


def test_old_and_missing_packages_are_faults_with_the_line_that_mends_them(monkeypatch: pytest.MonkeyPatch) -> None:
    real = metadata.version
    monkeypatch.setattr(metadata, "version", lambda name: "1.9.3" if name == "scipy" else real(name))
    monkeypatch.setattr(environment, "MODULES", {**environment.MODULES, "rich": "no_such_module"})
    found = environment.environment()["findings"]
    steps = {one["step"] for one in found if one["severity"] == "error"}
    assert {"pip install 'scipy>=1.15'", "pip install 'rich>=13.9'"} <= steps


def test_a_shadow_in_the_working_folder_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "clarabel.py").write_text("")
    monkeypatch.delitem(sys.modules, "clarabel", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    told = environment.package_findings({"packages": [environment.package_facts("clarabel", "0.1")], "extras": []})
    assert [one["severity"] for one in told] == ["error"]
    assert str(tmp_path / "clarabel.py") in told[0]["evidence"] and "rename the file" in told[0]["step"]


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_cache_that_cannot_be_written_is_a_warning(tmp_path: Path) -> None:
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    facts = {"threads": {"trouble": ""}, "caches": [{"for": ["model"], "writable": os.access(locked, os.W_OK)}]}
    facts |= {"dynident": {"version": "1"}, "packages": [], "extras": [], "variables": {}}
    told = environment.findings_of(facts)
    assert any("NUMBA_CACHE_DIR" in one["step"] and one["severity"] == "warning" for one in told)


def test_the_plain_answer_names_all_parts(capsys: pytest.CaptureFixture[str]) -> None:
    main(["environment"])
    shown = capsys.readouterr().out
    wanted = ("dynident ", "Python ", "numba", "processors: ", "compiled code: ", "C compiler: ")
    assert all(f"\n{text}" in f"\n{shown}" for text in wanted)
    assert all(f"\n{extra} " in shown for extra in environment.EXTRAS)
