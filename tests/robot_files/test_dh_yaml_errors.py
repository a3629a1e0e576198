"""Every fault in the YAML of a DH table, with its full message."""

from __future__ import annotations

from pathlib import Path

import pytest
from faulty_descriptions import GOOD_DH, Fault, assert_refused, assert_sound

CASES: dict[str, Fault] = {
    "list": (None, "- a\n- b\n", "a mapping (key: value) is needed, not a list of 2; write 'key: value' lines"),
    "scalar": (None, "hello\n", "a mapping (key: value) is needed, not 'hello'; write 'key: value' lines"),
    "comment only": (None, "# nothing\n", "the file is empty; write a table, or give another file"),
    "alias": (
        "convention: modified",
        "convention: &c modified",
        "line 2: anchors (&name) and aliases (*name) are not read; write the values out",
    ),
    "bomb": (
        None,
        "a: &a [x, x]\nb: &b [*a, *a]\n",
        "line 1: anchors (&name) and aliases (*name) are not read; write the values out",
    ),
    "merge": (
        "    damping: 0.5",
        "    <<: {damping: 0.5}",
        (
            "line 10, joints.1: unknown key '<<'; known keys: name, kind, a, alpha, d, theta, offset, limits, "
            "drive, damping, friction, link"
        ),
    ),
    "tag": (
        "name: arm",
        "name: !!python/object:os.system arm",
        (
            "line 1: the tag 'tag:yaml.org,2002:python/object:os.syste'... is not read; remove it: the "
            "meaning follows from the key"
        ),
    ),
    "key twice": (
        "    damping: 0.5",
        "    damping: 0.5\n    damping: 0.6",
        "line 11: the key 'damping' is there twice; keep one of the two",
    ),
    "key list": ("    damping: 0.5", "    ? [a]\n    : 1", "line 10: a key is not a text; write 'key: value'"),
    "not YAML": (
        "name: arm",
        'name: "arm',
        "line 24: not YAML (found unexpected end of stream); correct the line; indent with spaces",
    ),
    "tab": (
        "    damping: 0.5",
        "\tdamping: 0.5",
        ("line 10: not YAML (found character '\\t' that cannot start any token); correct the line; indent with spaces"),
    ),
    "two documents": (
        "name: arm",
        "---\nname: b\n---\nname: arm",
        "line 3: not YAML (but found another document); correct the line; indent with spaces",
    ),
    "not UTF-8": (None, b"name: \xff\xfe", "byte 6 is not UTF-8 text; save the file as UTF-8"),
    "control character": (
        None,
        b"name: \x07",
        "not YAML (special characters are not allowed); correct the line; indent with spaces",
    ),
    "escape in a name": (
        "name: arm",
        'name: "a\\e[31m"',
        "line 1, name: the name 'a\\x1b[31m' has characters that cannot be printed; use plain letters",
    ),
    "deep": (None, "a: " + "[" * 20 + "]" * 20, "line 1: more than 16 levels deep; give a table of one robot"),
    "many": (None, "a: [" + "x," * 20001 + "]", "line 1: more than 20000 values; give a table of one robot"),
    "large": (None, "# " + "x" * 1000000, "1000002 bytes is no size for a table; give a file of up to 1000000 bytes"),
}


@pytest.mark.parametrize("name", CASES)
def test_message(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused("bad.yaml", GOOD_DH, CASES[name])


def test_the_good_one_reads(tmp_path: Path) -> None:
    assert_sound(str(tmp_path / "good.yaml"), GOOD_DH)
