"""What a studio remembers of earlier sessions in its folder, after kills, full disks and clocks that jump."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

from dynident.files import sha256_of
from dynident.studio import history as histories
from dynident.studio.folder import Folder
from dynident.studio.history import Edit, History
from dynident.studio.orders import Order
from dynident.studio.runs import Run


def _ran(history: History, number: int) -> None:
    run = Run(number, Order("identify", ("identify", f"log_{number}.csv"), (f"estimate_{number}.json",)), None)
    run.state, run.code = "done", 0
    history.ran(run)


def _known(folder: Path) -> list[str]:
    return [run.order.arguments[1] for run in History(folder).runs]


def test_a_line_that_a_full_disk_cut_costs_that_line_alone(tmp_path: Path) -> None:
    history = History(tmp_path)
    _ran(history, 1)
    (file,) = tmp_path.glob(".studio-*.jsonl")
    with file.open("ab") as out:  # what reaches a full disk of the next entry, cut within a character
        out.write(b'\n{"number": 2, "verb": "identify", "arguments": ["identify", "log_2 \xc3')
    _ran(history, 3)
    history.wrote(Edit(3, "case.yaml", "robot: °\n"))
    assert _known(tmp_path) == ["log_1.csv", "log_3.csv"]
    later = History(tmp_path)
    assert later.commands(later.runs)[-1].startswith("cat > case.yaml")
    assert sum(bool(json.loads(line)) for line in file.read_bytes().split(b"\n") if line and b"log_2" not in line) == 3


def test_a_session_after_the_clock_was_set_back_comes_after_the_earlier_ones(tmp_path: Path, monkeypatch) -> None:
    _ran(History(tmp_path), 1)
    before = time.time_ns()
    monkeypatch.setattr(histories.time, "time_ns", lambda: before - 10**18)
    _ran(History(tmp_path), 2)
    (tmp_path / ".studio-copy.jsonl").write_text("{}\n[]\n5\n", encoding="utf-8")
    assert _known(tmp_path) == ["log_1.csv", "log_2.csv"]


def test_a_lock_that_a_killed_studio_left_before_the_clock_was_set_back_is_given_up(tmp_path: Path) -> None:
    (tmp_path / "case.yaml").write_text("old", encoding="utf-8")
    folder, lock = Folder(tmp_path), tmp_path / ".case.yaml.writing"
    lock.mkdir()
    ahead = time.time() + 1e5
    os.utime(lock, (ahead, ahead))
    folder.write("case.yaml", "new", sha256_of(tmp_path / "case.yaml"))
    assert (tmp_path / "case.yaml").read_text(encoding="utf-8") == "new"
    assert not lock.exists()
