"""What is installed and from where: to look at first when something fails, and to attach to an issue.

Versions and places of the packages, those that PYTHONPATH or the working folder shadows, caches with size and rights,
processors and threads, variables, optional packages with the line that installs each, and the C compiler for proofs of
exported code. Nothing is changed and nothing leaves the machine. The exit code is 1 where there is a fault.

  dynident environment
  dynident environment --json
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import platform
import re
import shutil
import sys
from importlib import metadata
from pathlib import Path
from types import FunctionType
from typing import Any

from dynident.cli import console
from dynident.cli.console import answer

SUMMARY = "what is installed and from where, and what is wrong with it"

#: What each extra is for.
EXTRAS = {
    "ros": "recordings of ROS 1 and 2, motions as bags",
    "parquet": "logs in Parquet",
    "mat": "MATLAB files of version 7.3",
    "pin": "Pinocchio: proof of exports, meshes; none for Windows",
    "mujoco": "MuJoCo: proof of exports, virtual cell",
    "casadi": "proof of exported CasADi modules",
    "dask": "work on a cluster, logs in buckets",
    "fmu": "proof of exported FMUs",
    "figures": "figures as PDF and PNG",
    "studio": "3-D view of the studio",
    "plot": "matplotlib: plots of an estimate in Python",
    "pandas": "estimates as pandas frames",
    "symbolic": "SymPy: equations of small arms as expressions",
    "xacro": "robot models as xacro",
    "usd": "robot models in USD",
}

#: Modules that packages are imported as, where the name is another one.
MODULES = {"pyyaml": "yaml", "pin": "pinocchio", "usd-core": "pxr"}

#: Endings of compiled code: numba's index and code, and the machine code of robots.
_CODE = (".nbi", ".nbc", ".dynident-code")

#: Variables that change what dynident or the libraries below it do.
_VARIABLES = (
    "DYNIDENT_DATA", "DYNIDENT_KERNEL", "NUMBA_CACHE_DIR", "NUMBA_DISABLE_JIT", "NUMBA_NUM_THREADS", "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "PYTHONPATH", "PYTHONHOME", "CC",
)  # fmt: skip

_FAULT, _WARNING = "error", "warning"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of lines")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    facts = environment()
    if options.json:
        console.answer_json(facts)
    else:
        _show(facts)
    return int(any(finding["severity"] == _FAULT for finding in facts["findings"]))


def environment() -> dict[str, Any]:
    """Return what is installed and from where, as plain data; no library that may be broken is needed for it."""
    needed = [package_facts(*wanted) for wanted in _requirements() if not wanted[2]]
    facts: dict[str, Any] = {
        "dynident": _own(),
        "python": {
            "version": platform.python_version(),
            "executable": sys.executable,
            "prefix": sys.prefix,
            "virtual": sys.prefix != sys.base_prefix,
            "system": f"{platform.system()} {platform.machine()}",
        },
        "packages": needed,
        "extras": _extras(),
        "variables": {name: os.environ[name] for name in _VARIABLES if name in os.environ},
        "threads": _threads(),
        "caches": _caches(),
        "compiler": _compiler(),
    }
    facts["findings"] = findings_of(facts)
    return facts


# --- facts -----------------------------------------------------------------------------------------------------------


def _own() -> dict[str, Any]:
    try:
        origin = json.loads(metadata.distribution("dynident").read_text("direct_url.json") or "{}")
    except (metadata.PackageNotFoundError, ValueError):
        origin = {}
    return {
        "version": _version("dynident"),
        "place": str(Path(__file__).parents[1]),
        "editable": bool(origin.get("dir_info", {}).get("editable")),
    }


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _requirements() -> list[tuple[str, str, str]]:
    """Return name, lowest version and extra (empty for the core) of everything that the installation asks for."""
    try:
        lines = metadata.requires("dynident") or []
    except metadata.PackageNotFoundError:
        return []
    found = []
    for line in lines:
        match = re.match(r"([\w.-]+)[^;]*?>=\s*([\w.]+)", line)
        extra = re.search(r"extra == ['\"]([\w-]+)['\"]", line)
        if match and not (sys.platform == "win32" and "sys_platform != 'win32'" in line):
            found.append((match[1].lower(), match[2], extra[1] if extra else ""))
    return found


def package_facts(name: str, lowest: str, _: str = "") -> dict[str, Any]:
    """Return what is known of a package without importing it."""
    module = MODULES.get(name, name)
    try:
        found = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        found = None
    place = found.origin if found else None
    return {"name": name, "version": _version(name), "lowest": lowest, "module": module, "place": place}


def _extras() -> list[dict[str, Any]]:
    wanted = _requirements()
    rows = []
    for extra, purpose in EXTRAS.items():
        packages = [package_facts(*one) for one in wanted if one[2] == extra]
        installed = bool(packages) and all(one["version"] for one in packages)
        line = f"pip install 'dynident[{extra}]'"
        rows.append({"name": extra, "for": purpose, "installed": installed, "install": line, "packages": packages})
    return rows


def _threads() -> dict[str, Any]:
    free = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    found: list[dict[str, Any]] = []
    trouble = ""
    try:
        import numpy  # noqa: F401  # both bring their own BLAS
        import scipy.linalg  # noqa: F401
        from threadpoolctl import threadpool_info

        for pool in threadpool_info():
            keys = ("internal_api", "version", "num_threads", "filepath")
            found.append({key: pool.get(key) for key in keys})
    except Exception as error:  # a broken installation can raise anything, and is what this command is asked about
        trouble = f"{type(error).__name__}: {error}"
    return {"processors": os.cpu_count(), "usable": free, "pools": found, "trouble": trouble}


def _caches() -> list[dict[str, Any]]:
    """Return the folders of compiled code: where numba would put it, and what is there."""
    package = Path(__file__).parents[1]
    files = [file for file in sorted(package.rglob("*.py")) if b"kernels.jit import" in file.read_bytes()]
    sources: dict[Path, list[Path]] = {}
    for file in files:
        if file.resolve() != Path(__file__).resolve():
            sources.setdefault(file.parent, []).append(file)
    places: dict[str | None, dict[str, Any]] = {}
    for folder, members in sources.items():
        place = cache_place(members[0])
        entry = places.setdefault(place, {"place": place, "for": [], "bytes": 0, "files": 0, "writable": False})
        entry["for"].append(str(folder.relative_to(package)))
        kept = [one for one in Path(place).iterdir() if one.suffix in _CODE] if place and Path(place).is_dir() else []
        sizes = [one.stat().st_size for one in kept if one.exists()]
        entry.update(bytes=sum(sizes), files=len(sizes), writable=bool(place) and os.access(place or "", os.W_OK))
    return list(places.values())


def cache_place(source: Path) -> str | None:
    """Return where numba keeps the compiled code of a file; None where it finds no folder that it can write."""
    try:
        from numba.core.caching import FunctionCache

        code = compile("def kernel():\n    pass\n", str(source), "exec").co_consts[0]
        return str(FunctionCache(FunctionType(code, {"__name__": "kernel"})).cache_path)
    except Exception:  # numba missing or broken, or "no locator available"
        return None


def _compiler() -> dict[str, str] | None:
    try:
        from dynident.exports.c_compiler import find_compiler

        found = find_compiler()
    except Exception:  # numpy may be the very thing that is broken
        command = next((name for name in ("cc", "gcc", "clang") if shutil.which(name)), None)
        return {"command": command, "name": command} if command else None
    return {"command": " ".join(found.command), "name": found.name} if found else None


# --- findings --------------------------------------------------------------------------------------------------------


def findings_of(facts: dict[str, Any]) -> list[dict[str, str]]:
    """Return severity, evidence and step of each fault of an installation."""
    found = [*_own_findings(facts), *package_findings(facts), *_variable_findings(facts["variables"])]
    if facts["threads"]["trouble"]:
        text = f"numpy, scipy or threadpoolctl cannot be imported ({facts['threads']['trouble']})"
        found.append(_finding(_FAULT, text, "install dynident into a fresh virtual environment"))
        return found
    for cache in facts["caches"]:
        if not cache["writable"]:
            text = f"compiled code of {', '.join(cache['for'])} has no folder that can be written"
            step = "every process compiles anew, about ten seconds; set NUMBA_CACHE_DIR to a folder of yours"
            found.append(_finding(_WARNING, text, step))
    return found


def _finding(severity: str, text: str, step: str) -> dict[str, str]:
    return {"severity": severity, "evidence": text, "step": step}


def _own_findings(facts: dict[str, Any]) -> list[dict[str, str]]:
    if facts["dynident"]["version"] is None:
        return [_finding(_FAULT, "dynident is imported from a folder, but not installed", "pip install it")]
    asked = {extra for _, _, extra in _requirements() if extra}
    stale = sorted(set(EXTRAS) - asked - ({"pin"} if sys.platform == "win32" else set()))
    if stale:
        text = f"the installation is older than the sources: it knows no extra {', '.join(stale)}"
        return [_finding(_WARNING, text, "install dynident again (pip install -e . in its folder)")]
    return []


def package_findings(facts: dict[str, Any]) -> list[dict[str, str]]:
    """Return the findings about packages that are missing, older than needed or shadowed by a file."""
    found = []
    optional = [one for extra in facts["extras"] for one in extra["packages"]]
    for one in [*facts["packages"], *optional]:
        name, version, core = one["name"], one["version"], one in facts["packages"]
        if core and one["place"] is None:
            found.append(_finding(_FAULT, f"{name} is not installed", f"pip install '{name}>={one['lowest']}'"))
        elif version and _numbers(version) < _numbers(one["lowest"]):
            text = f"{name} is {version}, older than {one['lowest']}"
            found.append(_finding(_FAULT if core else _WARNING, text, f"pip install '{name}>={one['lowest']}'"))
        if one["place"] and (core or version) and (shadow := _shadow_of(one)):
            found.append(_finding(_FAULT, *shadow))
    return found


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version.split("+", 1)[0])[:3])


def _shadow_of(package: dict[str, Any]) -> tuple[str, str] | None:
    """Return evidence and next step where another file than the installed one is imported."""
    place = Path(package["place"]).resolve()
    try:
        home = metadata.distribution(package["name"])
    except metadata.PackageNotFoundError:
        return None
    first = Path(package["module"])
    beside = {Path(str(home.locate_file(first))).resolve(), Path(str(home.locate_file(f"{first}.py"))).resolve()}
    owned = {Path(str(file.locate())).resolve() for file in home.files or () if first.name in file.parts[-2:-1]}
    if not beside.isdisjoint({place, *place.parents}) or place in owned:
        return None
    listed = [entry for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry]
    guilty = next((entry for entry in listed if Path(entry).resolve() in place.parents), None)
    text = f"{package['module']} is imported from {place}, not the installed {package['name']} {package['version']}"
    if guilty:
        return f"{text}: PYTHONPATH has {guilty}", "unset PYTHONPATH (setup.bash of ROS sets it) before dynident runs"
    return text, "rename the file or folder of that name, or run from another folder"


def _variable_findings(variables: dict[str, str]) -> list[dict[str, str]]:
    found = []
    own = f"python{sys.version_info.major}.{sys.version_info.minor}"
    for entry in variables.get("PYTHONPATH", "").split(os.pathsep):
        other = re.search(r"python3\.\d+", entry)
        if other and other[0] != own:
            text = f"PYTHONPATH has packages of {other[0]} ({entry}), this is {own}"
            found.append(_finding(_WARNING, text, "unset PYTHONPATH (setup.bash of ROS sets it) before dynident runs"))
    folder = variables.get("DYNIDENT_DATA")
    if folder and not Path(folder).is_dir():
        found.append(_finding(_WARNING, f"DYNIDENT_DATA names {folder}, which is no folder", "name one, or unset it"))
    kernel = variables.get("DYNIDENT_KERNEL", "auto")
    if kernel not in ("auto", "generic", "generated"):
        step = "unset it, or write auto, generic or generated"
        found.append(_finding(_FAULT, f"DYNIDENT_KERNEL is {kernel!r}", step))
    if variables.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        found.append(_finding(_WARNING, "NUMBA_DISABLE_JIT makes everything very slow", "unset it"))
    return found


# --- what is shown ---------------------------------------------------------------------------------------------------


def _show(facts: dict[str, Any]) -> None:
    own, python = facts["dynident"], facts["python"]
    answer(f"dynident {own['version'] or '(not installed)'} from {own['place']}{' (editable)' * own['editable']}")
    virtual = "virtual environment" if python["virtual"] else "no virtual environment"
    answer(f"Python {python['version']}, {python['executable']}, {virtual}, {python['system']}")
    answer()
    _columns(
        [("package", "version", "at least", "imported from")]
        + [(one["name"], one["version"] or "-", one["lowest"], one["place"] or "-") for one in facts["packages"]]
    )
    answer()
    rows = [("extra", "for", "found", "install with")]
    for extra in facts["extras"]:
        versions = [f"{one['name']} {one['version']}" for one in extra["packages"] if one["version"]]
        line = "" if extra["installed"] else extra["install"]
        rows.append((extra["name"], extra["for"], ", ".join(versions) or "-", line))
    _columns(rows)
    answer()
    threads = facts["threads"]
    pools = [f"{pool['internal_api']} {pool['version'] or ''}".strip() for pool in threads["pools"]]
    counts = [f"{name}: {pool['num_threads']}" for name, pool in zip(pools, threads["pools"], strict=True)]
    answer(
        f"processors: {threads['usable']} of {threads['processors']}; threads of {', '.join(counts) or 'no library'}"
    )
    _show_caches(facts["caches"])
    for name, value in facts["variables"].items():
        answer(f"{name}={value}")
    compiler = facts["compiler"]
    found = f"{compiler['command']} ({compiler['name']})" if compiler else "none; exported C is written, not proved"
    answer(f"C compiler: {found}")
    answer()
    for finding in facts["findings"]:
        answer(f"{finding['severity']}: {finding['evidence']}; {finding['step']}")
    if not facts["findings"]:
        answer("nothing wrong was found")


def _show_caches(caches: list[dict[str, Any]]) -> None:
    size = f"{sum(one['bytes'] for one in caches) / 1e6:.1f} MB in {sum(one['files'] for one in caches)} files"
    places = sorted({one["place"] for one in caches if one["place"]})
    root = os.path.commonpath(places) if places else "nowhere"
    rights = "writable" if all(one["writable"] for one in caches) else "NOT writable everywhere"
    answer(f"compiled code: {size} under {root}, {rights}")


def _columns(rows: list[tuple[str, ...]]) -> None:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    for row in rows:
        answer("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
