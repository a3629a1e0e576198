"""Files are written whole or not at all."""

from __future__ import annotations

import hashlib
import os

import pytest

from dynident.errors import FileError
from dynident.files import sha256_of, write_atomically


@pytest.mark.parametrize("data", ["t,q1\r\n°\n", b"\x00\xff\n"])
def test_text_and_bytes_are_written_as_they_are(tmp_path, data):
    path = tmp_path / "out.txt"
    write_atomically(path, data)
    content = data.encode() if isinstance(data, str) else data
    assert path.read_bytes() == content
    assert sha256_of(path) == hashlib.sha256(content).hexdigest()
    write_atomically(str(path), "new")
    assert path.read_text() == "new"
    assert os.listdir(tmp_path) == ["out.txt"]


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "out.txt"
    write_atomically(path, "old")

    def full(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(FileError) as caught:
        write_atomically(path, "new")
    assert str(caught.value) == (
        f"{path}: cannot be written (no space left on device); check the folder, its rights and the space left"
    )
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["out.txt"]


def test_an_interrupt_leaves_nothing_behind(tmp_path, monkeypatch):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(tmp_path / "out.txt", "new")
    assert not os.listdir(tmp_path)


@pytest.mark.skipif(os.name != "posix", reason="modes and links of POSIX")
def test_an_existing_file_keeps_its_mode_and_a_link_stays_a_link(tmp_path):
    path, link = tmp_path / "out.txt", tmp_path / "link"
    path.write_text("old")
    path.chmod(0o640)
    link.symlink_to(path)
    write_atomically(link, "new")
    assert link.is_symlink()
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("missing/out.txt", "there is no folder '{folder}/missing'; create it or choose another place"),
        ("folder", "this is a folder; give the name of a file"),
    ],
)
def test_places_that_cannot_be_written(tmp_path, place, message):
    (tmp_path / "folder").mkdir()
    with pytest.raises(FileError) as caught:
        write_atomically(tmp_path / place, "new")
    assert str(caught.value) == f"{tmp_path / place}: {message.format(folder=tmp_path)}"


@pytest.mark.skipif(os.name != "posix", reason="devices of POSIX")
def test_a_device_is_not_replaced():
    with pytest.raises(FileError, match="no ordinary file"):
        write_atomically("/dev/null", "new")


def test_hashing_what_is_not_there(tmp_path):
    with pytest.raises(FileError, match="there is no such file; check the path"):
        sha256_of(tmp_path / "missing")


def test_a_folder_has_the_hash_of_the_names_and_contents_of_its_files(tmp_path):
    def written(name, text):
        (tmp_path / name).write_text(text)
        return sha256_of(tmp_path)

    found = [written("a", "1"), written("b", "2"), written("b", "3"), written("b", "2")]
    assert found[1] == found[3] and len(set(found)) == 3
