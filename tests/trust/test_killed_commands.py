"""Every long command, killed or interrupted at random moments, or refused disk and rights: old or new files, one line.

Commands run in forks of a server that has the packages loaded, so that nearly every moment is one of their own work.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import math
import multiprocessing
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from one_joint_arm import URDF, write_run

from short_benchmark import benchmark_text

pytestmark = [pytest.mark.battery, pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")]

KILLS, INTERRUPTS = 6, 4
CASE = """case: 1
robot: arm.urdf
friction: [viscous]
estimator: consistent
train: [run0.csv]
preprocessing: {filter: {butterworth: {cutoff_hz: 5}}, rate_hz: 50}
"""
BENCHMARK = benchmark_text("arm.urdf", "[viscous]", draws=2)


@dataclass(frozen=True)
class Job:
    """A long command.

    Attributes:
        words: Its words, in the folder with the inputs; ``OUT`` stands for a folder of its own.
        files: What it writes, below OUT.
        codes: Exit codes of a run to its end.
        goes_on: Whether it keeps finished work in OUT and goes on from it.
    """

    words: str
    files: tuple[str, ...] = ()
    codes: tuple[int, ...] = (0,)
    goes_on: bool = False


_FIT = "identify case.yaml run0.csv --cross-validate 0"
JOBS = {
    "identify": Job(f"{_FIT} -o OUT/new.json --report OUT/page.html", ("new.json", "page.html")),
    "compare": Job("compare case.yaml --estimators ols,wls --report OUT/page.html", ("page.html",)),
    "benchmark": Job("benchmark mine.yaml --out OUT/kept --html OUT/page.html", ("page.html",), goes_on=True),
    "excite": Job(
        "excite arm.urdf --starts 2 --time-limit 60 --period 5 --resume OUT/search -o OUT/new.json --csv OUT/new.csv",
        ("new.json", "new.csv"),
        goes_on=True,
    ),
    "simulate": Job("simulate cell.yaml plan.json -o OUT/a.csv", ("a.csv", "a.truth.json", "a.truth.npz")),
    "selftest": Job("selftest cell.yaml --plan plan.json --repeats 2", codes=(0, 1)),
    "report": Job("report r0.json -o OUT/page.html --test run1.csv", ("page.html",)),
    "export": Job("export r0.json --to urdf -o OUT/new.urdf", ("new.urdf", "new.urdf.dynident.json")),
    "reduce": Job("reduce case.yaml run0.csv run1.csv -o OUT/new.tri --checkpoint 0.01", ("new.tri",), goes_on=True),
    "merge": Job("merge r0.tri r1.tri -o OUT/new.tri", ("new.tri",)),
    "fleet": Job("fleet r0.json r1.json -o OUT", ("r0.json", "r1.json", "fleet.json")),
    "track": Job("track r0.json run1.csv -o OUT/new.csv", ("new.csv",), codes=(0, 1)),
    "monitor": Job("monitor r0.json run1.csv", codes=(0, 1)),
    "init": Job("init arm.urdf run0.csv run1.csv -o OUT/new.yaml --force", ("new.yaml",)),
}


def _started(words: list[str], folder: str, told: str, world: str) -> None:
    """Run a command in its process and leave with its exit code."""
    from dynident.cli.main import main

    signal.signal(signal.SIGINT, signal.default_int_handler)  # a run in the background inherits that it is ignored
    os.chdir(folder)
    for number, place in ((1, os.devnull), (2, f"{told}.part")):
        os.dup2(os.open(place, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644), number)
    sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
    Path(f"{told}.part").rename(told)  # from here on it is the command that is stopped
    if world == "full disk":
        import resource  # not on Windows

        resource.setrlimit(resource.RLIMIT_FSIZE, (500, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
    elif world:
        _without_rights()
    code = main([*words, "--quiet"])
    sys.stderr.flush()
    os._exit(code)


def _without_rights() -> None:
    """Give up what lets root pass over the rights of files: capabilities, by capset(2)."""
    if os.geteuid() == 0:
        header = (ctypes.c_uint32 * 2)(0x20080522, 0)
        assert ctypes.CDLL(None, use_errno=True).capset(header, (ctypes.c_uint32 * 6)()) == 0


@pytest.fixture(scope="module")
def forks() -> Any:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    context = multiprocessing.get_context("forkserver")
    cli = [f"dynident.cli.{name}" for name in ("main", *JOBS)]
    context.set_forkserver_preload(
        [*cli, "dynident.identification.identify", "dynident.results.report", "scipy.signal"]
    )
    return context


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with an arm of one joint, two logs, their estimates and triangles, a plan and a benchmark."""
    from dynident.cli.main import main

    folder = tmp_path_factory.mktemp("cell")
    (folder / "arm.urdf").write_text(URDF)
    (folder / "case.yaml").write_text(CASE)
    (folder / "mine.yaml").write_text(BENCHMARK)
    (folder / "cell.yaml").write_text(CASE.replace("train: [run0.csv]\n", "") + "cell: {controller: pd}\n")
    with contextlib.chdir(folder):
        for k in range(2):
            write_run(Path(f"run{k}.csv"), 3000, k)
            assert main(f"identify case.yaml run{k}.csv --cross-validate 0 -o r{k}.json --quiet".split()) == 0
            assert main(f"reduce case.yaml run{k}.csv -o r{k}.tri --quiet".split()) == 0
        assert main("excite arm.urdf --starts 1 --time-limit 1 --period 5 -o plan.json --quiet".split()) == 0
    return folder


def begun(forks: Any, job: Job, cell: Path, out: Path, world: str = "") -> Any:
    words = [word.replace("OUT", str(out)) for word in job.words.split()]
    told = out.parent / "told.txt"
    told.unlink(missing_ok=True)
    process = forks.Process(target=_started, args=(words, str(cell), str(told), world))
    process.start()
    while not told.exists():
        time.sleep(0.001)
    return process


def content(place: Path) -> object:
    """Return what a result says, without clock times and places; whole, or an error."""
    if place.suffix == ".json":
        data = json.loads(place.read_text())
        return data.get("beta") or data.get("trajectory") or data.get("robots") or data.get("links") or sorted(data)
    if place.suffix in (".tri", ".npz"):
        with np.load(place) as arrays:
            return {name: arrays[name].tolist() for name in arrays.files if name != "about"}
    text = place.read_text("utf-8")
    if place.suffix in (".html", ".urdf"):
        return text.rstrip().endswith(("</html>", "</robot>"))
    return re.sub(r"\S*/out\b\S*", "", text)


@pytest.mark.parametrize("name_of", JOBS)
def test_a_long_command_that_is_killed_or_interrupted(
    name_of: str, forks: Any, cell: Path, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """Each stop leaves every file as it was or as a run to the end makes it; Ctrl-C is one line and code 130."""
    job, out, told = JOBS[name_of], tmp_path / "out", tmp_path / "told.txt"
    out.mkdir()
    longest = 0.0
    for _ in range(2):  # the first may compile for long what the next find in the cache
        shutil.rmtree(out)
        out.mkdir()
        whole = begun(forks, job, cell, out)
        clock = time.monotonic()
        whole.join()
        longest = time.monotonic() - clock
        assert whole.exitcode in job.codes, told.read_text()
    done = {name: content(out / name) for name in job.files}
    draw, stopped = random.Random(name_of), {signal.SIGKILL: 0, signal.SIGINT: 0}
    for sign in [signal.SIGKILL] * KILLS + [signal.SIGINT] * INTERRUPTS:
        if job.goes_on and draw.random() < 0.5:  # else it goes on from where it was stopped before
            shutil.rmtree(out)
            out.mkdir()
        for name in job.files:
            (out / name).write_bytes(b"old")
        process = begun(forks, job, cell, out)
        process.join(draw.uniform(0.02, 0.9) * longest)
        if process.is_alive():
            os.kill(process.pid, sign)
            process.join(60)
            if process.exitcode in (130, -signal.SIGKILL):
                stopped[sign] += 1
            if process.exitcode == 130:
                assert told.read_text().splitlines()[-1].startswith("stopped") and "Traceback" not in told.read_text()
        assert process.exitcode in (*job.codes, 130, -signal.SIGKILL), told.read_text()
        for name in job.files:
            assert (out / name).read_bytes() == b"old" or content(out / name) == done[name], name
        if not job.goes_on:
            known = {*job.files, *(path.name for path in out.glob(".*.part"))}
            assert {path.name for path in out.iterdir()} <= known
    record_property("stopped", f"{stopped[signal.SIGKILL]} {stopped[signal.SIGINT]} {longest:.2f}")
    assert all(stopped.values()) and sum(stopped.values()) > math.ceil((KILLS + INTERRUPTS) / 4)
    last = begun(forks, job, cell, out)
    last.join()
    assert last.exitcode in job.codes and {name: content(out / name) for name in job.files} == done


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="capabilities of Linux")
@pytest.mark.parametrize("world", ["full disk", "read-only folder", "input that may not be read"])
@pytest.mark.parametrize("name", JOBS)
def test_a_long_command_that_is_refused(name: str, world: str, forks: Any, cell: Path, tmp_path: Path) -> None:
    job, out, told = JOBS[name], tmp_path / "out", tmp_path / "told.txt"
    if not job.files and not world.startswith("input"):
        pytest.skip("it writes no file")
    out.mkdir()
    for file in job.files:
        (out / file).write_bytes(b"old")
    read = next(cell / word for word in job.words.split()[1:] if (cell / word).is_file())
    shut = {"full disk": None, "read-only folder": out}.get(world, read)
    if shut is not None:
        shut.chmod(0o555 if shut == out else 0)
    try:
        process = begun(forks, job, cell, out, world)
        process.join()
    finally:
        read.chmod(0o644)
        out.chmod(0o755)
    said = told.read_text().splitlines()
    assert process.exitcode == 1 and said[-1].startswith("error: ") and "Traceback" not in told.read_text()
    named = (str(out), read.name, f"{tempfile.gettempdir()}: a temporary file cannot be written")
    assert any(place in said[-1] for place in named)
    assert all((out / file).read_bytes() == b"old" for file in job.files)
    assert not list(out.glob(".*.part"))
