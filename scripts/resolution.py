"""Does pip find wheels for every system and Python? One line each; files of exact versions in the folder (needs uv).

Core and extras are resolved from wheels alone, in the highest versions and in the lowest that pyproject.toml allows.
Extras that a system has no wheels for are named in ``LEFT_OUT``. Run: python scripts/resolution.py FOLDER
"""

import itertools
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SYSTEMS = ("x86_64-manylinux_2_28", "aarch64-manylinux_2_28", "x86_64-apple-darwin", "aarch64-apple-darwin", "windows")
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
LEFT_OUT = {"x86_64-apple-darwin": ("mujoco",)}  # pyproject.toml leaves `pin` out on Windows


def main() -> None:
    """Resolve all, write what was found, and exit with 1 where something has no wheels."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    failed = False
    for system, python in itertools.product(SYSTEMS, PYTHONS):
        some = [name for name in extras if name not in LEFT_OUT.get(system, ())]
        for what, mode in itertools.product(("core", "extras"), ("highest", "lowest-direct")):
            out = folder / f"{system}-{python}-{what}-{mode}.txt"
            command = ["uv", "pip", "compile", "--quiet", str(ROOT / "pyproject.toml"), "--only-binary", ":all:"]
            command += ["--python-platform", system, "--python-version", python, "--resolution", mode]
            command += [word for name in some if what == "extras" for word in ("--extra", name)]
            done = subprocess.run([*command, "--output-file", str(out)], capture_output=True, text=True, check=False)
            failed |= done.returncode != 0
            said = "wheels" if done.returncode == 0 else " ".join(done.stderr.split())
            print(f"{system} {python} {what} {mode}: {said}", flush=True)
    sys.exit(int(failed))


if __name__ == "__main__":
    main()
