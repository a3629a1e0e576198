"""Does a changed tree answer as before? Record what the program answers, by its command line only, and compare.

    python scripts/recording record --out before
    python scripts/recording record --out after --inputs before
    python scripts/recording compare before after

A recording has inputs/ (made by the first, used again by the second, so that both answer the same questions) and
answers/, a folder for each step of steps.py with what the command printed, its exit code and the files that it wrote.
Numbers agree to 1e-9, those of iterations to 1e-6; what was renamed on purpose stands in renames.yaml. Real logs are
looked for under DYNIDENT_DATA, else in ../shared/data beside the repository.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import inputs
from comparing import EXACT, ITERATED, Comparison, Difference, Renames
from steps import FULL, LEFT_OUT, QUICK, Step, exports, on_real_logs, on_strangers

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
#: One thread, so that sums have one order; no colours, one width.
SETTINGS = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "NO_COLOR": "1",
    "TERM": "dumb",
    "COLUMNS": "120",
}


class Recorder:
    """Runs commands of a tree in the folder of a recording and keeps what they answer."""

    def __init__(self, tree: Path, folder: Path) -> None:
        self.tree, self.folder = tree, folder
        data = Path(os.environ.get("DYNIDENT_DATA") or ROOT.parent / "shared" / "data")
        self.data = data.resolve()
        self.environment = {**os.environ, **SETTINGS, "PYTHONPATH": str(tree / "src"), "DYNIDENT_DATA": str(self.data)}
        self.steps: dict[str, dict[str, object]] = {}

    def run(self, step: Step) -> str:
        """Run a step and return what it printed.

        Raises:
            RuntimeError: The command does not exist as it is called here, or ended with a traceback.
        """
        place = self.folder / "answers" / step.name
        place.mkdir(parents=True, exist_ok=True)
        words = step.words.replace("{out}", f"answers/{step.name}")
        words += "" if words.startswith("completion") else " --json"
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(
            [sys.executable, "-m", "dynident", *shlex.split(words)],
            cwd=self.folder, env=self.environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
        )  # fmt: skip
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        took = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        if done.returncode not in (0, 1) or "Traceback (most recent call last)" in done.stderr:
            raise RuntimeError(f"dynident {words}\nended with {done.returncode}: {done.stderr[-2000:]}")
        (place / ("stdout.json" if _is_json(done.stdout) else "stdout.txt")).write_text(done.stdout, encoding="utf-8")
        (place / "stderr.txt").write_text(done.stderr, encoding="utf-8")
        self.steps[step.name] = {
            "command": words,
            "exit": done.returncode,
            "iterated": step.iterated,
            "processor_s": round(took, 2),
        }
        print(f"{took:6.1f} s  exit {done.returncode}  {step.name}", flush=True)
        return done.stdout

    def made(self, step: Step) -> None:
        """Run a step that makes an input.

        Raises:
            RuntimeError: It failed.
        """
        self.run(step)
        done = self.steps.pop(step.name)
        if done["exit"]:
            message = (self.folder / "answers" / step.name / "stderr.txt").read_text(encoding="utf-8")
            raise RuntimeError(f"dynident {done['command']}\nended with 1: {message[-2000:]}")


def _is_json(text: str) -> bool:
    try:
        json.loads(text)
    except ValueError:
        return False
    return True


def steps_of(recorder: Recorder, tier: str) -> Iterator[Step]:
    """Yield the steps of a tier, once the inputs are there."""
    listed = json.loads(recorder.run(QUICK[0]))
    yield from (step for step in QUICK if step is not QUICK[0])
    # A tree older than the wings lists the exporters of motions as "exporters".
    motions = listed["motion_exporters"] if "motion_exporters" in listed else listed["exporters"]
    families = {"motion_exporters": motions, "model_exporters": listed["model_exporters"]}
    names = {family: [part["name"] for part in parts] for family, parts in families.items()}
    if tier == "quick":
        yield from exports(names, tier)
        return
    yield from FULL
    yield from exports(names, tier)
    yield from on_real_logs()
    yield from on_strangers(json.loads((recorder.folder / "inputs/strangers/strangers.json").read_text("utf-8")))


def record(tree: Path, folder: Path, tier: str, older: Path | None) -> None:
    """Make a recording.

    Args:
        tree: Repository whose program answers.
        folder: To be made.
        tier: ``quick`` or ``full``.
        older: Recording whose inputs are used again; None: they are made.

    Raises:
        ValueError: The folder is there, or the older recording has the inputs of fewer steps.
    """
    if folder.exists():
        raise ValueError(f"{folder} is there: name a new folder")
    if older is not None and tier == "full" and _about(older)["tier"] == "quick":
        raise ValueError(f"{older} was recorded with --quick: repeat it with --quick, or make new inputs")
    recorder = Recorder(tree, folder)
    folder.mkdir(parents=True)
    if older is None:
        inputs.make(tree, folder, tier, recorder.made)
    else:
        shutil.copytree(older / "inputs", folder / "inputs")
    (folder / "data").symlink_to(recorder.data)
    skipped = []
    for step in steps_of(recorder, tier):
        if step.needs and not (recorder.data / step.needs).is_dir():
            skipped.append(step.name)
            print(f"left out: {step.name}, no {step.needs} under {recorder.data}")
        else:
            recorder.run(step)
    asked = {str(one["command"]).split()[0] for one in recorder.steps.values()}
    about = {
        "tier": tier,
        "folder": str(folder),
        "tree": str(tree),
        "data": str(recorder.data),
        "skipped": skipped,
        "steps": recorder.steps,
    }
    (folder / "recording.json").write_text(json.dumps(about, indent=1), encoding="utf-8")
    took = sum(float(str(one["processor_s"])) for one in recorder.steps.values())
    print(f"{len(recorder.steps)} commands, {took:.0f} s of processor time, {len(skipped)} left out, in {folder}")
    refused = [name for name, one in recorder.steps.items() if one["exit"]]
    print(f"exit code 1: {', '.join(refused) or 'none'}")
    print(f"{len(asked)} of the program's commands; not recorded: {', '.join(LEFT_OUT)}")


def compare(older: Path, newer: Path, renames: Renames, numbers_only: bool) -> list[Difference]:
    """Return what differs between two recordings.

    Raises:
        ValueError: They answer different questions.
    """
    about = [_about(place) for place in (older, newer)]
    ours, theirs = (_files(place / "inputs") for place in (older, newer))
    if ours != theirs:
        other = sorted(name for name in {*ours, *theirs} if ours.get(name) != theirs.get(name))
        raise ValueError(f"the inputs are not the same ({other[0]}): record the newer one with --inputs {older}")
    old, new = (one["steps"] for one in about)
    scrub = tuple(map(_scrubber, about))
    differences = [
        Difference(name, "step", f"only in the {'older' if name in old else 'newer'} recording")
        for name in sorted({*old} ^ {*new})
    ]
    differences += [
        Difference(name, "exit code", f"{old[name]['exit']} -> {new[name]['exit']}")
        for name in old
        if name in new and old[name]["exit"] != new[name]["exit"]
    ]
    for name in old:
        if name in new:
            tolerance = ITERATED if old[name]["iterated"] else EXACT
            comparison = Comparison(renames, (scrub[0], scrub[1]), numbers_only)
            files = (
                {f"{name}/{file}": data for file, data in _files(place / "answers" / name).items()}
                for place in (older, newer)
            )
            differences += comparison.folders(*files, lambda _, own=tolerance: own)
    return differences


def _about(recording: Path) -> dict[str, Any]:
    """Return what a recording says of itself.

    Raises:
        ValueError: It is none, or it was not finished.
    """
    try:
        return json.loads((recording / "recording.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ValueError(f"{recording} is no recording, or was not finished") from None


def _files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def _scrubber(about: dict[str, Any]) -> Callable[[str], str]:
    """Return what takes the places of a recording out of a text."""
    pairs = [(about[key], f"<{key}>") for key in ("folder", "tree", "data")]

    def scrub(text: str) -> str:
        for place, stand_in in pairs:
            text = text.replace(place, stand_in)
        return text

    return scrub


def _summary(differences: list[Difference]) -> str:
    if not differences:
        return "no difference"
    files = len({one.file for one in differences})
    return f"{len(differences)} difference{'s' * (len(differences) > 1)} in {files} file{'s' * (files > 1)}"


def main() -> int:
    """Record or compare; return 1 where something differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("record", help="record what a tree answers")
    one.add_argument("--out", type=Path, required=True, help="folder to be made")
    one.add_argument("--inputs", type=Path, help="recording whose inputs are used again")
    one.add_argument("--quick", action="store_true", help="every command and every export once, no real logs")
    one.add_argument("--tree", type=Path, default=ROOT, help="repository to ask; default: the one of this script")
    two = commands.add_parser("compare", help="compare two recordings")
    two.add_argument("older", type=Path)
    two.add_argument("newer", type=Path)
    two.add_argument("--renames", type=Path, default=HERE / "renames.yaml", help="what was renamed on purpose")
    two.add_argument("--numbers-only", action="store_true", help="leave texts and strings out")
    options = parser.parse_args()
    try:
        if options.command == "record":
            older = options.inputs.resolve() if options.inputs else None
            record(options.tree.resolve(), options.out.resolve(), "quick" if options.quick else "full", older)
            return 0
        differences = compare(options.older, options.newer, Renames.read(options.renames), options.numbers_only)
    except ValueError as error:
        parser.error(str(error))
    print(*differences, sep="\n", end="\n" if differences else "")
    print(_summary(differences))
    return 1 if differences else 0


if __name__ == "__main__":
    sys.exit(main())
