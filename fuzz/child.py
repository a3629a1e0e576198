"""The process that executes: by own changes of sound files, or guided by the branches that atheris counts."""

from __future__ import annotations

import os
import random
import sys
import time
import warnings
from pathlib import Path
from typing import Any

from fuzz.mutations import mutated
from fuzz.targets import TARGETS
from fuzz.trial import Trials


def main(name: str, runs: int, first: int, seconds: float, way: str, kept: Path, folder: Path) -> None:
    """Execute ``runs`` inputs behind the first ``first`` for some seconds, or the kept input that ``way`` names."""
    target = TARGETS[name]
    warnings.simplefilter("ignore")
    atheris: Any = None
    if way == "guided":
        import atheris  # type: ignore[no-redef,import-not-found]

        with atheris.instrument_imports(include=["dynident", "xacro"], exclude=_others(target.instrument)):
            _load(target.instrument)
    seeds = target.prepare(folder, name)
    for content in seeds:
        sound = folder / f"sound{target.suffix}"
        sound.write_bytes(content)
        target.read(sound)  # has to succeed, and loads what reading needs
    trials = Trials(target, folder, kept)
    trials.limit_memory()
    if way == "guided":
        _guided(atheris, trials, name, seeds, runs, first, seconds, kept)
    elif way == "plain":
        _plain(trials, name, seeds, runs, first, seconds, folder)
    else:
        sys.exit(trials.judge((kept / way).read_bytes())[1] or 0)


def _others(packages: tuple[str, ...]) -> list[str]:
    """Return the modules of dynident outside some packages: their branches would cost time and guide nowhere."""
    import dynident

    root = Path(dynident.__path__[0])
    names = (".".join(("dynident", *path.relative_to(root).with_suffix("").parts)) for path in root.rglob("*.py"))
    modules = {name.removesuffix(".__init__") for name in names}
    return [name for name in modules if not any(f"{name}.".startswith(f"{package}.") for package in packages)]


def _load(packages: tuple[str, ...]) -> None:
    import importlib
    import pkgutil

    for package in packages:
        module = importlib.import_module(package)
        for one in pkgutil.iter_modules(getattr(module, "__path__", [])):
            importlib.import_module(f"{package}.{one.name}")


def _plain(trials: Trials, name: str, seeds: list[bytes], runs: int, first: int, seconds: float, folder: Path) -> None:
    """Execute inputs that follow from their number alone."""
    target = TARGETS[name]
    ended = time.monotonic() + seconds
    number = os.open(folder / "number", os.O_WRONLY | os.O_CREAT)
    for k in range(first, first + runs):
        draw = random.Random(f"{name} {k}")
        os.pwrite(number, b"%20d" % k, 0)
        trials.run(mutated(target.kind, draw.choice(seeds), draw.choice(seeds), draw, target.words))
        if time.monotonic() > ended:
            break
    trials.save()


def _guided(
    atheris: Any,
    trials: Trials,
    name: str,
    seeds: list[bytes],
    runs: int,
    first: int,
    seconds: float,
    kept: Path,
) -> None:
    """Execute inputs that are changes of those that reached new branches; these are kept for the next time."""
    target = TARGETS[name]
    corpus = kept / "corpus"
    corpus.mkdir(exist_ok=True)
    for k, content in enumerate(seeds):
        (corpus / f"sound{k}").write_bytes(content)
    changed = False

    def change(data: bytes, most: int, number: int) -> bytes:
        nonlocal changed
        changed = True
        draw = random.Random(number)
        way = draw.random()
        if way < 0.2:
            return atheris.Mutate(data, most)
        start = data if way < 0.6 else draw.choice(seeds)  # sound files lead behind the first check that refuses
        return mutated(target.kind, start, draw.choice(seeds), draw, target.words)[:most]

    def one(data: bytes) -> None:
        if not changed:  # the corpus, which was counted when it was found
            trials.judge(data)
            return
        trials.run(data)
        if sum(trials.score.values()) >= runs:
            trials.save()
            os._exit(0)

    most = max(1000, 4 * max(map(len, seeds)))  # what is longer takes its time and tells no more
    options = [f"-max_total_time={max(1, int(seconds))}", f"-seed={first + 1}", f"-max_len={most}", "-len_control=0"]
    options += ["-rss_limit_mb=0", "-timeout=600", f"-artifact_prefix={kept}/", "-verbosity=1", "-handle_int=0"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], one, custom_mutator=change)
    try:
        atheris.Fuzz()
    finally:
        trials.save()


if __name__ == "__main__":
    words = sys.argv[1:]
    main(words[0], int(words[1]), int(words[2]), float(words[3]), words[4], Path(words[5]), Path(words[6]))
