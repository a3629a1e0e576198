"""The exact versions that the set-up installs are those that every supported Python and system needs, no more."""

from __future__ import annotations

import importlib.metadata
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent
SYSTEMS = {"Linux": ("linux", "posix"), "Darwin": ("darwin", "posix"), "Windows": ("win32", "nt")}


def _pinned() -> dict[str, Requirement]:
    lines = (ROOT / "constraints" / "dev.txt").read_text(encoding="utf-8").splitlines()
    pins = [Requirement(line.rstrip(" \\")) for line in lines if line and line[0] not in " #"]
    return {canonicalize_name(pin.name): pin for pin in pins}


def _needed(here: dict[str, str]) -> set[str]:
    """Return the packages that the project and its tests need, and what these need, by what is installed."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    groups = project["dependency-groups"]
    own = [*project["project"]["dependencies"], *groups["build"], *groups["test"], *groups["lint"]]
    waiting = [(one, "") for one in map(Requirement, own)]
    seen: set[tuple[str, str]] = set()
    while waiting:
        one, asked_by = waiting.pop()
        if one.marker is not None and not one.marker.evaluate(here | {"extra": asked_by}):
            continue
        name = canonicalize_name(one.name)
        for extra in {"", *one.extras} - {known for package, known in seen if package == name}:
            seen.add((name, extra))
            try:
                waiting += [(Requirement(text), extra) for text in importlib.metadata.requires(name) or []]
            except importlib.metadata.PackageNotFoundError:  # of another system or Python
                continue
    return {name for name, _ in seen}


def _installed(name: str) -> bool:
    try:
        importlib.metadata.distribution(name)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13", "3.14"])
def test_each_python_and_system_gets_the_packages_that_it_needs(python: str, system: str) -> None:
    platform, kind = SYSTEMS[system]
    here = {"python_version": python, "python_full_version": f"{python}.0", "implementation_name": "cpython"}
    here |= {"platform_system": system, "sys_platform": platform, "os_name": kind}
    got = {name for name, pin in _pinned().items() if pin.marker is None or pin.marker.evaluate(here)}
    needed = _needed(here)
    assert needed <= got
    assert not {name for name in got - needed if _installed(name)}  # what others ask for is known of these alone
