"""The machine and the versions behind a figure."""

from __future__ import annotations

import os
import platform
import re
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import scipy.linalg  # loads the BLAS that is to be named
from threadpoolctl import threadpool_info

PACKAGES = ("dynident", "numpy", "scipy", "numba", "llvmlite")


def machine() -> dict[str, Any]:
    """Return processor, cores, memory, load, versions and BLAS of this moment."""
    assert scipy.linalg
    blas = [lib for lib in threadpool_info() if lib["user_api"] == "blas"]
    load = os.getloadavg() if hasattr(os, "getloadavg") else (float("nan"),) * 3
    return {
        "taken": datetime.now(UTC).strftime("%Y-%m-%d"),
        "processor": processor(),
        "cores": os.cpu_count(),
        "memory_gib": round(memory() / 2**30, 1),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "versions": {name: metadata.version(name) for name in PACKAGES},
        "blas": sorted({f"{lib['internal_api']} {lib['version']}" for lib in blas}),
        "load_before": [round(value, 2) for value in load],
    }


def processor() -> str:
    """Return the model of the processor."""
    told = Path("/proc/cpuinfo")
    names = re.findall(r"^model name\s*: (.*)$", told.read_text(), re.MULTILINE) if told.is_file() else []
    return names[0] if names else platform.processor() or platform.machine()


def memory() -> int:
    """Return the size of the memory in bytes; 0 where the system does not tell."""
    if not hasattr(os, "sysconf"):
        return 0
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
