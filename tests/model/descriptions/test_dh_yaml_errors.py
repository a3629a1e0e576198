"""Every fault in the YAML of a DH table, with its full message."""

from __future__ import annotations

from pathlib import Path

import pytest

from dynident.errors import DescriptionError
from dynident.model.descriptions import read_robot

GOOD = """name: arm
convention: modified
joints:
  - name: swivel
    a: 0
    alpha: -pi/2
    d: 0.3
    limits: {lower: -1, upper: 1, velocity: 2}
    drive: {gear_ratio: 100, rotor_inertia: 1e-4, gain: 5}
    damping: 0.5
    link:
      name: upper
      inertia:
        mass: 1.5
        centre_of_mass: [0.1, 0, 0]
        about_centre: [0.01, 0, 0, 0.02, 0, 0.03]
  - name: slide
    kind: prismatic
    a: 0.2
    alpha: 0
    theta: 0
tool: {translation: [0, 0, 0.1]}
coupling: [[1, 0], [0.5, 1]]
"""

#: What to replace by what (None: the whole file), and the message after the file name.
CASES: dict[str, tuple[str | None, str | bytes, str]] = {
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
        "line 24: not YAML (found unexpected end of stream); mend the line; indent with spaces",
    ),
    "tab": (
        "    damping: 0.5",
        "\tdamping: 0.5",
        ("line 10: not YAML (found character '\\t' that cannot start any token); mend the line; indent with spaces"),
    ),
    "two documents": (
        "name: arm",
        "---\nname: b\n---\nname: arm",
        "line 3: not YAML (but found another document); mend the line; indent with spaces",
    ),
    "not UTF-8": (None, b"name: \xff\xfe", "byte 6 is not UTF-8 text; save the file as UTF-8"),
    "control character": (
        None,
        b"name: \x07",
        "not YAML (special characters are not allowed); mend the line; indent with spaces",
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
    old, new, message = CASES[name]
    assert old is None or old in GOOD
    text = new if isinstance(new, bytes) else new.encode()
    Path("bad.yaml").write_bytes(text if old is None else GOOD.encode().replace(old.encode(), text, 1))
    with pytest.raises(DescriptionError) as caught:
        read_robot("bad.yaml")
    assert str(caught.value) == f"bad.yaml: {message}"
    assert "\n" not in str(caught.value)


def test_the_good_one_reads(tmp_path: Path) -> None:
    path = tmp_path / "good.yaml"
    path.write_text(GOOD)
    assert read_robot(path).name == "arm"
