"""Run every benchmark, one after the other, each in a process of its own. Run: python -m benchmarks.run

Peers that are not installed are skipped, and named, by each benchmark. BLAS runs on one thread.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

ORDER = ("regressor", "identification", "consistency", "simulation", "bias", "colony", "swarm", "readers", "real_data")


def main() -> None:
    print(f"{platform.platform()}, Python {platform.python_version()}, {os.cpu_count()} cores")
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    failed = []
    for name in ORDER:
        if name == "real_data" and not Path(os.environ.get("DYNIDENT_DATA", "missing")).is_dir():
            print("\nreal_data: left out, DYNIDENT_DATA names no folder")
            continue
        print(f"\n{name}", flush=True)
        if subprocess.run([sys.executable, "-m", f"benchmarks.{name}"], env=environment, check=False).returncode:
            failed.append(name)
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")


if __name__ == "__main__":
    main()
