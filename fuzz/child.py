"""The process that executes: by own changes of sound files, or guided by the branches that atheris counts."""

from __future__ import annotations

import random
import sys
import warnings
from pathlib import Path
from typing import Any

from fuzz.mutations import mutated
from fuzz.targets import TARGETS
from fuzz.trial import Trials


def main(name: str, runs: int, seed: int, first: int, guided: bool, kept: Path, folder: Path) -> None:
    """Execute ``runs`` inputs, from number ``first``; number and seed decide what input it is."""
    target = TARGETS[name]
    warnings.simplefilter("ignore")
    atheris: Any = None
    if guided:
        import atheris  # type: ignore[no-redef,import-not-found]

        with atheris.instrument_imports(include=list(target.instrument)):
            _load(target.instrument)
    seeds = target.prepare(folder, name)
    for content in seeds:
        sound = folder / f"sound{target.suffix}"
        sound.write_bytes(content)
        target.read(sound)  # has to succeed, and loads what reading needs
    trials = Trials(target, folder, kept)
    trials.limit_memory()
    if guided:
        _guided(atheris, trials, name, seeds, runs, seed, kept)
        return
    for number in range(first, runs):
        draw = random.Random(f"{name} {seed} {number}")
        (kept / "number").write_text(str(number))
        trials.run(mutated(target.kind, draw.choice(seeds), draw.choice(seeds), draw, target.words))
    trials.save()


def _load(packages: tuple[str, ...]) -> None:
    import importlib
    import pkgutil

    for package in packages:
        module = importlib.import_module(package)
        for one in pkgutil.iter_modules(getattr(module, "__path__", [])):
            importlib.import_module(f"{package}.{one.name}")


def _guided(atheris: Any, trials: Trials, name: str, seeds: list[bytes], runs: int, seed: int, kept: Path) -> None:
    target = TARGETS[name]
    corpus = kept / "corpus"
    corpus.mkdir(exist_ok=True)
    for k, content in enumerate(seeds):
        (corpus / f"sound{k}").write_bytes(content)

    def change(data: bytes, most: int, number: int) -> bytes:
        draw = random.Random(number)
        if draw.random() < 0.3:
            return atheris.Mutate(data, most)
        return mutated(target.kind, data, draw.choice(seeds), draw, target.words)[:most]

    def one(data: bytes) -> None:
        trials.run(data)
        if sum(trials.score.values()) >= runs:
            trials.save()

    options = [f"-runs={runs}", f"-seed={seed or 1}", "-max_len=1048576", "-rss_limit_mb=0", "-timeout=60"]
    options += ["-print_final_stats=1", f"-artifact_prefix={kept}/", "-verbosity=1", "-handle_int=0"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], one, custom_mutator=change)
    try:
        atheris.Fuzz()
    finally:
        trials.save()


if __name__ == "__main__":
    words = sys.argv[1:]
    main(words[0], int(words[1]), int(words[2]), int(words[3]), words[4] == "guided", Path(words[5]), Path(words[6]))
