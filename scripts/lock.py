"""Write constraints/*.txt: exact versions with hashes, no addresses, for every system and Python version (needs uv).

``core`` is what the package needs, ``dev`` adds the tests, ``bench`` the peers that benchmarks run beside it; ``docs``,
``release``, ``coverage`` and ``notebooks`` stand alone. All take what they share with ``dev`` in its versions, so that
all can go into one environment. Names on the command line choose some.
"""

import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FLAGS = ["--universal", "--python-version", "3.11", "--fork-strategy", "fewest"]  # one version a package, with markers
FLAGS += ["--generate-hashes", "--no-header", "--no-annotate", "--quiet"]


def main() -> None:
    """Resolve the core dependencies, and the development groups; versions that stand in the files are kept."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    groups = project["dependency-groups"]
    core = [*project["project"]["dependencies"], *groups["build"]]
    wanted = {"core": core, "dev": [*core, *groups["test"], *groups["lint"]], "bench": [*core, *groups["bench"]]}
    wanted |= {name: groups[name] for name in ("docs", "release", "coverage", "notebooks")}
    for name in sys.argv[1:] or wanted:
        target = ROOT / "constraints" / f"{name}.txt"
        with tempfile.TemporaryDirectory() as folder:
            shared = Path(folder) / "dev.txt"
            shared.write_text("" if name in ("core", "dev") else pins(ROOT / "constraints" / "dev.txt"))
            command = [sys.executable, "-m", "uv", "pip", "compile", *FLAGS, "--output-file", str(target)]
            command += ["--constraint", str(shared), "-"]
            subprocess.run(command, input="\n".join(wanted[name]), text=True, check=True)
        print(f"wrote {target.relative_to(ROOT)}")


def pins(path: Path) -> str:
    """Return the versions of a file of constraints without their hashes."""
    return "\n".join(re.findall(r"^[\w.-]+==[^\s\\]+", path.read_text(), re.MULTILINE))


if __name__ == "__main__":
    main()
