"""Several writers in one folder: studios, commands beside them, uploads at the same time; nobody's file is lost."""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from stand_ins import StandInRuns, order, until

from dynident import files
from dynident.errors import BadOption, FileError
from dynident.studio.folder import Folder
from dynident.studio.orders import order_of
from dynident.studio.runs import AT_ONCE, Run, Runs


def _started(runs: Runs, folder: Folder, wait: float = 0.0, code: int = 0, name: str = "") -> Run:
    """Start what stands for a command, under the name that is next where none is given."""
    return runs.start(order(name or folder.reserve("estimate", ".json"), wait, code))


def test_two_sessions_reserve_different_names(tmp_path: Path) -> None:
    first, second = Folder(tmp_path), Folder(tmp_path)
    names = [session.reserve("estimate", ".json") for session in (first, second, first)]
    assert names == ["estimate_1.json", "estimate_2.json", "estimate_3.json"]
    assert first.names() == second.names() == ()
    first.release(names[:1])
    assert second.reserve("estimate", ".json") == "estimate_1.json"


def test_a_name_is_reserved_by_making_something_that_only_one_can_make(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "dynident.studio.folder.os.listdir", lambda place: []
    )  # both have looked before either reserves
    names = [Folder(tmp_path).reserve("estimate", ".json") for _ in range(3)]
    assert len(set(names)) == 3


def test_a_folder_that_takes_nothing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", refused)
    with pytest.raises(FileError, match=r"cannot be written in \(Permission denied\); check its rights"):
        Folder(tmp_path).reserve("estimate", ".json")


def test_a_request_that_fails_gives_its_names_back(tmp_path: Path) -> None:
    for name in ("c.yaml", "e.json"):
        (tmp_path / name).write_text("")
    session = Folder(tmp_path)
    with pytest.raises(FileError):
        order_of(session, "validate", {"estimate": "none.json"})
    with pytest.raises(BadOption):
        order_of(session, "compare", {"case": "c.yaml", "estimators": ["ols"], "time_limit": 0})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c.yaml", "e.json"]


def test_a_run_that_cannot_start_gives_its_names_back(tmp_path: Path) -> None:
    session = Folder(tmp_path)
    runs = StandInRuns(session)
    for _ in range(AT_ONCE):
        _started(runs, session, wait=60.0)
    with pytest.raises(BadOption, match="run already"):
        _started(runs, session)
    assert len(list(tmp_path.iterdir())) == AT_ONCE
    runs.close()
    assert list(tmp_path.iterdir()) == []  # at the end of the session, not some time after it
    with pytest.raises(BadOption, match="the session has ended"):
        _started(runs, session)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ends", ["cancelled", "failed"])
def test_a_run_that_is_broken_off_takes_nothing_of_others_with_it(tmp_path: Path, ends: str) -> None:
    first, second = Folder(tmp_path), Folder(tmp_path)
    runs, others = StandInRuns(first), StandInRuns(second)
    run = _started(runs, first, wait=60.0 if ends == "cancelled" else 0.0, code=1)
    other = _started(others, second)
    until(lambda: run.progress and other.state == "done")
    for name in ("estimate_1.json", "estimate_1-note.csv", ".estimate_1.json.0.part"):  # of a command beside them
        (tmp_path / name).write_text("of another")
    if ends == "cancelled":
        runs.cancel(run.number)
    until(lambda: run.state == ends and not (tmp_path / ".estimate_1.reserved").exists())
    left = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert left == {
        "estimate_1.json": "of another",
        "estimate_1-note.csv": "of another",
        ".estimate_1.json.0.part": "of another",
        "estimate_2.json": "estimate_2.json",
    }
    for name in ("estimate_1.json", "estimate_2.json"):
        with pytest.raises(FileError, match="it was there before the session"):
            first.remove(name)


def test_a_run_keeps_what_it_wrote_beside_what_another_has_written_meanwhile(tmp_path: Path) -> None:
    session = Folder(tmp_path)
    runs = StandInRuns(session)
    name = session.reserve("estimate", ".json")
    (tmp_path / "estimate_1.json").write_text("of another")
    run = _started(runs, session, name=name)
    until(lambda: run.state == "done")
    assert run.outputs == run.figures()["outputs"] == ["estimate_1_2.json"]
    assert run.progress[-1] == "estimate_1.json was written by another program meanwhile: kept as estimate_1_2.json"
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {
        "estimate_1.json": "of another",
        "estimate_1_2.json": "estimate_1.json",
    }


def test_a_run_whose_files_cannot_be_kept_has_failed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("dynident.studio.folder.move_to_new_name", full)
    session = Folder(tmp_path)
    runs = StandInRuns(session)
    run = _started(runs, session)
    until(lambda: run.state == "failed")
    assert "No space left on device" in run.progress[-1] and list(tmp_path.iterdir()) == []


def test_a_staged_file_goes_to_the_store_and_through_no_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "STAGED", {})
    work, store = tmp_path / "work", tmp_path / "store"
    for place in (work, store, work / "sub"):
        place.mkdir()
    (tmp_path / "mine").write_text("mine")
    (work / "plan.json").symlink_to(tmp_path / "mine")
    files.stage(work, store)
    monkeypatch.chdir(work)
    for name in ("plan.json", "./a.csv", "sub/../b.csv", "sub/c.csv"):
        files.write_atomically(name, "new")
    assert (tmp_path / "mine").read_text() == "mine"
    assert {path.name for path in store.iterdir()} == {"plan.json", "a.csv", "b.csv"}
    assert {path.name for path in work.iterdir()} == {"plan.json", "sub"} and (work / "sub" / "c.csv").exists()


@pytest.mark.parametrize("links", [True, False])
def test_a_file_moves_to_a_name_that_nothing_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, links: bool) -> None:
    def none(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")  # as exFAT answers

    if not links:
        monkeypatch.setattr("dynident.files.os.link", none)
    source = tmp_path / "part"
    source.write_text("new")
    (tmp_path / "file").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    (tmp_path / "folder").mkdir()
    for name in ("file", "link", "folder"):
        with pytest.raises(FileExistsError):
            files.move_to_new_name(source, tmp_path / name)
    files.move_to_new_name(source, tmp_path / "free")
    assert (tmp_path / "free").read_text() == "new" and (tmp_path / "file").read_text() == "old"
    assert not source.exists() and not (tmp_path / "nowhere").exists()


class Slow(io.BytesIO):
    """A body of which something else happens before it has come."""

    def __init__(self, content: bytes, meanwhile: Callable[[], object]) -> None:
        super().__init__(content)
        self._meanwhile: list[Callable[[], object]] = [meanwhile]

    def read(self, size: int | None = -1, /) -> bytes:
        while self._meanwhile:
            self._meanwhile.pop()()
        return super().read(size)


def test_a_slow_upload_writes_over_nothing_that_came_meanwhile(tmp_path: Path) -> None:
    session = Folder(tmp_path)
    kept: list[str] = []

    def meanwhile() -> None:
        kept.append(session.receive("mine.csv", io.BytesIO(b"fast"), 4))
        (tmp_path / "mine_2.csv").write_bytes(b"saved by hand")
        (tmp_path / "mine_3.csv").symlink_to(tmp_path / "nowhere")

    kept.append(session.receive("mine.csv", Slow(b"slow", meanwhile), 4))
    assert kept == ["mine.csv", "mine_4.csv"]
    contents = {name: (tmp_path / name).read_bytes() for name in session.names()}
    assert contents == {"mine.csv": b"fast", "mine_2.csv": b"saved by hand", "mine_4.csv": b"slow"}


def test_an_upload_leaves_the_names_that_a_command_has_reserved(tmp_path: Path) -> None:
    session = Folder(tmp_path)
    session.reserve("estimate", ".json")
    assert session.receive("estimate_1.json", io.BytesIO(b"x"), 1) == "estimate_1_2.json"


def test_uploads_at_the_same_time_have_one_limit(tmp_path: Path) -> None:
    session = Folder(tmp_path, 10)
    refused: list[str] = []

    def upload(more: int) -> None:
        """Upload a file, and before it has come, or where it is refused, one more."""

        def another() -> None:
            if more:
                upload(more - 1)

        try:
            session.receive("a.csv", Slow(b"x" * 9, another), 9)
        except FileError as error:
            refused.append(str(error))
            another()

    upload(11)
    assert session.names() == ("a.csv", "a_2.csv", "a_3.csv", "a_4.csv")
    assert len(refused) == 8 and all("too many beside" in message for message in refused)
    with pytest.raises(FileError, match="only 1 of 4 bytes came"):
        session.receive("b.csv", io.BytesIO(b"x"), 4)
    assert session.receive("b.csv", io.BytesIO(b"x" * 4), 4) == "b.csv"  # what did not come takes no room


def test_uploads_at_the_same_time_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dynident.studio.folder.MAX_FILES", 2)
    session = Folder(tmp_path)

    def third() -> None:
        with pytest.raises(FileError, match="the session has 2 files"):
            session.receive("c.csv", io.BytesIO(b"x"), 1)

    second = Slow(b"x", third)
    session.receive("a.csv", Slow(b"x", lambda: session.receive("b.csv", second, 1)), 1)
    assert session.names() == ("a.csv", "b.csv")


def test_of_two_studios_that_save_one_file_at_once_one_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "case.yaml").write_text("before")
    seen = files.sha256_of(tmp_path / "case.yaml")

    def slowly(path: Path, text: str) -> None:
        time.sleep(0.2)  # both have looked at the file by then
        files.write_atomically(path, text)

    monkeypatch.setattr("dynident.studio.folder.write_atomically", slowly)
    refused: list[str] = []

    def save(text: str) -> None:
        try:
            Folder(tmp_path).write("case.yaml", text, seen)
        except FileError:
            refused.append(text)

    savers = [threading.Thread(target=save, args=(text,)) for text in ("one", "other")]
    for saver in savers:
        saver.start()
    for saver in savers:
        saver.join()
    assert len(refused) == 1 and (tmp_path / "case.yaml").read_text() == {"one": "other", "other": "one"}[refused[0]]
    assert [path.name for path in tmp_path.iterdir()] == ["case.yaml"]


def test_a_studio_that_was_killed_while_it_saved_holds_nobody_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "case.yaml").write_text("before")
    seen = files.sha256_of(tmp_path / "case.yaml")
    (tmp_path / ".case.yaml.writing").mkdir()
    monkeypatch.setattr("dynident.studio.folder.TRIES", 2)
    with pytest.raises(FileError, match="another studio is writing it"):
        Folder(tmp_path).write("case.yaml", "after", seen)
    monkeypatch.setattr("dynident.studio.folder.LEFT_BEHIND", 0.0)
    Folder(tmp_path).write("case.yaml", "after", seen)
    assert (tmp_path / "case.yaml").read_text() == "after"
