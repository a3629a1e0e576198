"""The comparison of recordings: what it finds, leaves aside and renames."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from loaded_file import loaded_file

SCRIPTS = Path(__file__).resolve().parents[1] / "scripts"


comparing = loaded_file("scripts/recording/comparing.py", "recording_comparing")
EXACT, ITERATED = comparing.EXACT, comparing.ITERATED


def differences_of(a: object, b: object, tolerance: object = EXACT, **options: object) -> list[str]:
    return [str(one) for one in comparing.Comparison(**options).values("f", a, b, tolerance)]


def table(tmp_path: Path, text: str) -> object:
    (tmp_path / "renames.yaml").write_text(text)
    return comparing.Renames.read(tmp_path / "renames.yaml")


def packed(**members: bytes) -> bytes:
    box = io.BytesIO()
    with zipfile.ZipFile(box, "w") as archive:
        for name, data in members.items():
            archive.writestr(name.replace("_", "."), data)
    return box.getvalue()


def test_numbers_are_compared_with_the_tolerance_of_their_command_and_the_scale_of_their_list() -> None:
    assert differences_of({"a": [1.0, 2.0]}, {"a": [1.0 + 5e-10, 2]}) == []
    assert differences_of({"a": [1.0, 2.0]}, {"a": [1.0 + 5e-9, 2]}) == ["f: a: at 0: 1.0 -> 1.000000005"]
    assert differences_of({"a": [1.0, 2.0]}, {"a": [1.0 + 5e-9, 2]}, ITERATED) == []
    assert differences_of({"a": [10.0, 0.0]}, {"a": [10.0, 9e-12]}) == []
    assert differences_of({"a": [0.1, 0.0]}, {"a": [0.1, 9e-12]}) == ["f: a: at 1: 0.0 -> 9e-12"]
    rows = [{"v": 10.0, "s": 0.0}, {"v": 0.0, "s": 0.0}]
    assert differences_of(rows, [{"v": 10.0, "s": 0.0}, {"v": 9e-12, "s": 0.0}]) == []
    assert differences_of(rows, [{"v": 10.0, "s": 9e-12}, {"v": 0.0, "s": 8e-12}]) == [
        "f: [].s: 0.0 -> 9e-12 (2 differ, this the most)"
    ]
    assert differences_of({"a": 1}, {"a": 1.0}) == [] and differences_of([float("nan")], [float("nan")]) == []
    for one, other in ((1.0, None), (1.0, True), (1.0, float("inf")), (0, False), ([1.0], [1.0, 2.0]), ([], {})):
        assert differences_of({"a": one}, {"a": other}) and differences_of({"a": other}, {"a": one})


def test_keys_strings_and_what_says_nothing_of_the_numbers() -> None:
    a = {"fit": {"seconds": 1.0, "extras": {"seconds": 1.0}}, "hash": "0" * 64, "made by": "dynident 0.1.0"}
    b = {"fit": {"seconds": 1.0, "extras": {"seconds": 2.0}}, "hash": "1" * 64, "made by": "dynident 0.2.0"}
    assert differences_of(a, b) == []
    assert differences_of({"proofs": [{"relative": 1e-16}]}, {"proofs": [{"relative": 2e-15}]}) == []
    assert differences_of({"proofs": [{"relative": 1e-16}]}, {"proofs": [{"relative": 2e-6}]})
    assert differences_of({"seconds": 1.0}, {"seconds": 2.0}) == ["f: seconds: 1.0 -> 2.0"]
    assert (
        differences_of({"a": "x"}, {"a": "y"}) == ["f: a: x -> y"]
        and differences_of({"a": "x"}, {"a": "y"}, numbers_only=True) == []
    )
    assert differences_of({"a": 1, "b": 2}, {"a": 1, "c": 2}) == [
        "f: b: only in the older answers: 2",
        "f: c: only in the newer answers: 2",
    ]
    scrub = (lambda text: text.replace("/old", "."), lambda text: text.replace("/new", "."))
    assert differences_of({"p": "/old/x"}, {"p": "/new/x"}, scrub=scrub) == []


def test_renames_carry_older_answers_to_the_new_names(tmp_path: Path) -> None:
    older = {"schema": 1, "fit": {"joints": [{"sd": 1.0}, {"sd": 2.0}], "prior": 3}, "said": "the wing of x"}
    newer = {
        "schema": 2,
        "train": {"drives": [{"deviation": 1.0}, {"deviation": 2.0}]},
        "said": "the room of x",
        "n": 1,
    }
    text = """keys: {"fit.joints[].sd": "train.drives[].deviation"}
values: {schema: {1: 2}}
words: {wing: room}
gone: [fit.prior]
added: [n]
"""
    assert len(differences_of(older, newer)) == 6
    assert differences_of(older, newer, renames=table(tmp_path, text)) == []
    newer["train"]["drives"][1]["deviation"] = 2.5  # type: ignore[index]
    assert differences_of(older, newer, renames=table(tmp_path, text)) == ["f: train.drives[].deviation: 2.0 -> 2.5"]
    with pytest.raises(ValueError, match="other numbers of"):
        table(tmp_path, "keys: {'a[].b': c}")
    with pytest.raises(ValueError, match="unknown key key"):
        table(tmp_path, "key: {a: b}")
    assert comparing.Renames.read(SCRIPTS / "recording" / "renames.yaml") is not None


def test_texts_arrays_and_archives() -> None:
    compare = comparing.Comparison().contents
    assert compare("f.h", b"x1 = 1.0;\ny = 2.5", b"x1 = 1.0000000001;\ny = 2.50", EXACT) == []
    assert [str(one) for one in compare("f.h", b"x1 = 1;\n", b"x2 = 1;\n", EXACT)] == [
        "f.h: words: line 1: x1 = 1; -> x2 = 1;"
    ]
    assert [one.place for one in compare("f.h", b"a 1\nb 2", b"a 1.1\nmore\nb 2.1", EXACT)] == ["numbers", "words"]
    arrays = []
    for value in (1.0, 1.0, 1.1):
        arrays.append(io.BytesIO())
        np.save(arrays[-1], np.array([[1.0, 5.0], [value, 6.0]]))
    one, same, other = (packed(a_npy=data.getvalue(), b_so=bytes([k])) for k, data in enumerate(arrays))
    assert compare("f.npz", one, same, EXACT) == []
    assert [str(one) for one in compare("f.npz", one, other, EXACT)] == ["f.npz/a.npy: array: at 1, 0: 1.0 -> 1.1"]
    assert [str(one) for one in compare("f.npz", one, packed(b_so=b"0"), EXACT)] == [
        "f.npz/a.npy: file: only in the older answers"
    ]
    about = [io.BytesIO(), io.BytesIO()]
    for box, text in zip(about, (b'{"a": 1.0}', b'{"a": 1.00}'), strict=True):
        np.save(box, np.frombuffer(text, np.uint8))
    assert compare("a.npy", about[0].getvalue(), about[1].getvalue(), EXACT) == []
    assert compare("f.bag", b"\xff\x00", b"\xff\x01", EXACT)


def test_two_folders_by_the_command(tmp_path: Path) -> None:
    for name in ("older", "newer"):
        (tmp_path / name / "answers" / "one").mkdir(parents=True)
        (tmp_path / name / "inputs").mkdir()
        (tmp_path / name / "answers" / "one" / "stdout.json").write_text(json.dumps({"a": [1.0, 2.0]}))
        about = {"folder": "/f", "tree": "/t", "data": "/d", "steps": {"one": {"exit": 0, "iterated": False}}}
        (tmp_path / name / "recording.json").write_text(json.dumps(about))
    command = [sys.executable, str(SCRIPTS / "recording"), "compare", "older", "newer"]
    (tmp_path / "newer" / "answers" / "one" / "stdout.json").write_text(json.dumps({"a": [1.0, 2.001]}))
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stdout == "one/stdout.json: a: at 1: 2.0 -> 2.001\n1 difference in 1 file\n"
