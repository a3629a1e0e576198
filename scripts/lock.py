"""Write constraints/core.txt and constraints/dev.txt: exact versions with hashes, no addresses (needs pip-tools)."""

import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FLAGS = ["--generate-hashes", "--no-emit-index-url", "--no-emit-find-links", "--no-emit-trusted-host", "--no-header"]
FLAGS += ["--allow-unsafe", "--strip-extras", "--no-annotate", "--quiet"]


def main() -> None:
    """Resolve the core dependencies, and the core with the development groups."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    groups = project["dependency-groups"]
    core = [*project["project"]["dependencies"], *groups["build"]]
    for name, wanted in {"core": core, "dev": [*core, *groups["test"], *groups["lint"]]}.items():
        target = ROOT / "constraints" / f"{name}.txt"
        command = [sys.executable, "-m", "piptools", "compile", *FLAGS, "--output-file", str(target), "-"]
        subprocess.run(command, input="\n".join(wanted), text=True, check=True)
        print(f"wrote {target.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
