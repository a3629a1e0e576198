"""Does the suite pass with the lowest and with the highest versions of each dependency? One environment for each.

``lowest`` takes the bounds of pyproject.toml, of core and extras, as versions; ``highest`` the newest releases;
constraints have no say. Environments and what pytest said stay in the folder; an environment that is there is kept.
Run: python scripts/bounds.py FOLDER [lowest] [highest] [-- WORDS FOR PYTEST]   (default: both, the whole short suite)
"""

import re
import subprocess
import sys
import tomllib
import venv
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BOUND = re.compile(r"(?P<name>[\w.-]+)\s*>=\s*(?P<version>[\w.]+)(?P<rest>[^;]*)(?P<marker>;.*)?")


def requirements(which: str) -> list[str]:
    """Return what pip is asked for, the tools of the tests in any version that goes with it."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = project["project"]["optional-dependencies"]
    own = [*project["project"]["dependencies"], *(line for lines in extras.values() for line in lines)]
    groups = project["dependency-groups"]
    rest = [line for name in ("test", "build") for line in groups[name] if isinstance(line, str)]
    if which == "highest":
        return [*own, *rest]
    pinned = [lowest(line) for line in own]
    names = {name_of(line) for line in own}
    return [*pinned, *(line for line in rest if name_of(line) not in names)]


def lowest(line: str) -> str:
    """Return a requirement with its lower bound as the version."""
    found = BOUND.fullmatch(line.strip())
    if found is None:
        raise SystemExit(f"pyproject.toml: '{line}' has no lower bound; write name>=version")
    return f"{found['name']}=={found['version']}{found['marker'] or ''}"


def name_of(line: str) -> str:
    """Return the name of a requirement, as packages are compared."""
    return re.sub(r"[-_.]+", "-", re.split(r"[\s<>=!~;\[]", line.strip(), maxsplit=1)[0]).lower()


def tested(folder: Path, which: str, words: Sequence[str]) -> int:
    """Return what pytest ends with in an environment of the lowest or the highest versions."""
    place = folder / which
    python = place / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    ready = place / "ready"
    if not ready.exists():
        venv.create(place, clear=True, with_pip=True)
        pip = [str(python), "-m", "pip", "install", "--quiet", "--only-binary", ":all:"]
        subprocess.run([*pip, *requirements(which)], check=True)
        own = ["--no-deps", "--no-build-isolation", "-e", str(ROOT)]
        subprocess.run([str(python), "-m", "pip", "install", "--quiet", *own], check=True)
        ready.touch()
    versions = subprocess.run([str(python), "-m", "pip", "freeze"], check=True, capture_output=True, text=True).stdout
    (folder / f"{which}.txt").write_text(versions, encoding="utf-8")
    command = [str(python), "-m", "pytest", "-q", "-p", "no:cacheprovider", *(words or ("-m", "not battery"))]
    done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=ROOT)
    (folder / f"{which}.log").write_text(done.stdout + done.stderr, encoding="utf-8")
    last = (done.stdout.strip().splitlines() or ["pytest said nothing"])[-1]
    print(f"{which}: {last}", flush=True)
    return done.returncode


def main() -> None:
    """Test what is asked for, and exit with 1 where a test failed."""
    given, words = sys.argv[1:], []
    if "--" in given:
        words = given[given.index("--") + 1 :]
        given = given[: given.index("--")]
    if not given or set(given[1:]) - {"lowest", "highest"}:
        raise SystemExit(__doc__)
    folder = Path(given[0])
    folder.mkdir(parents=True, exist_ok=True)
    codes = [tested(folder, which, words) for which in given[1:] or ("lowest", "highest")]
    sys.exit(int(any(codes)))


if __name__ == "__main__":
    main()
