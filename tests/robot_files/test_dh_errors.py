"""Every fault in the YAML and the values of a DH table, with its full message."""

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
    "no convention": (
        "convention: modified\n",
        "",
        (
            "line 1, convention: is missing; write 'convention: standard' (a, alpha after the joint) or "
            "'convention: modified' (before it, Craig)"
        ),
    ),
    "convention": (
        "modified",
        "craig",
        (
            "line 2, convention: 'craig' is not known here; write 'convention: standard' (a, alpha after the "
            "joint) or 'convention: modified' (before it, Craig)"
        ),
    ),
    "no name": ("name: arm\n", "", "line 1, name: is missing; add it"),
    "name null": ("name: arm", "name: ~", "line 1, name: is missing; add it"),
    "name list": ("name: arm", "name: [a]", "line 1, name: a text is needed, not a list of 1; write a text"),
    "unknown key": (
        "alpha: -pi/2",
        "alfa: -pi/2",
        (
            "line 6, joints.1: unknown key 'alfa'; known keys: name, kind, a, alpha, d, theta, offset, "
            "limits, drive, damping, friction, link; did you mean 'alpha'?"
        ),
    ),
    "unknown root key": (
        "tool:",
        "tol:",
        (
            "line 22: unknown key 'tol'; known keys: name, convention, gravity, joints, tool, coupling, note; "
            "did you mean 'tool'?"
        ),
    ),
    "degrees": (
        "name: arm",
        "name: arm\ndegrees: true",
        "line 2: unknown key 'degrees'; known keys: name, convention, gravity, joints, tool, coupling, note",
    ),
    "no alpha": ("    alpha: -pi/2\n", "", "line 4, joints.1.alpha: is missing; add it"),
    "no d": ("    d: 0.3\n", "", "line 4, joints.1.d: is missing; add it"),
    "no theta": ("    theta: 0\n", "", "line 17, joints.2.theta: is missing; add it"),
    "kind": (
        "prismatic",
        "linear",
        "line 18, joints.2.kind: 'linear' is not known here; choose one of: revolute, prismatic",
    ),
    "text": ("d: 0.3", "d: high", "line 7, joints.1.d: 'high' is not a number; write one plain number, without a unit"),
    "comma": ("d: 0.3", "d: 0,3", "line 7, joints.1.d: '0,3' is not a number; write a decimal point: 0.3"),
    "unit": ("d: 0.3", "d: 0.3m", "line 7, joints.1.d: '0.3m' is not a number; write one plain number, without a unit"),
    "nan": ("d: 0.3", "d: .nan", "line 7, joints.1.d: '.nan' is not a finite number; write a finite number"),
    "inf": ("d: 0.3", "d: .inf", "line 7, joints.1.d: '.inf' is not a finite number; write a finite number"),
    "overflow": ("d: 0.3", "d: 1e400", "line 7, joints.1.d: '1e400' is too large; write a number in SI units"),
    "overflow product": (
        "d: 0.3",
        "d: 1e40*1e40",
        "line 7, joints.1.d: '1e40*1e40' is too large; write a number in SI units",
    ),
    "sexagesimal": (
        "d: 0.3",
        "d: 1:30",
        "line 7, joints.1.d: '1:30' is not a number; write one plain number, without a unit",
    ),
    "boolean": (
        "d: 0.3",
        "d: yes",
        "line 7, joints.1.d: 'yes' is not a number; write one plain number, without a unit",
    ),
    "list for number": (
        "d: 0.3",
        "d: [0.3]",
        "line 7, joints.1.d: a number is needed, not a list of 1; write a number",
    ),
    "empty number": ("d: 0.3", "d:", "line 7, joints.1.d: is missing; add it"),
    "sum": (
        "-pi/2",
        "pi+1",
        "line 6, joints.1.alpha: 'pi+1' is not a number; write a number, or a product such as pi/2",
    ),
    "juxtaposed": (
        "-pi/2",
        "2pi",
        "line 6, joints.1.alpha: '2pi' is not a number; write a number, or a product such as pi/2",
    ),
    "zero division": (
        "-pi/2",
        "pi/0",
        "line 6, joints.1.alpha: 'pi/0' divides by zero; write a number, or a product such as pi/2",
    ),
    "code": (
        "-pi/2",
        "__import__('os')",
        "line 6, joints.1.alpha: \"__import__('os')\" is not a number; write one plain number, without a unit",
    ),
    "empty factor": (
        "-pi/2",
        "pi/",
        "line 6, joints.1.alpha: '' is not a number; write a number, or a product such as pi/2",
    ),
    "limits crossed": (
        "lower: -1",
        "lower: 2",
        "line 8, joints.1.limits: the lower limit 2 is above the upper limit 1; exchange or correct them",
    ),
    "limits negative": (
        "velocity: 2",
        "velocity: -2",
        "line 8, joints.1.limits.velocity: -2 is negative; write 0 or more",
    ),
    "limits key": (
        "velocity: 2",
        "speed: 2",
        (
            "line 8, joints.1.limits: unknown key 'speed'; known keys: lower, upper, velocity, acceleration, "
            "jerk, effort, effort_rate"
        ),
    ),
    "limits list": (
        "{lower: -1, upper: 1, velocity: 2}",
        "[-1, 1]",
        "line 8, joints.1.limits: a mapping (key: value) is needed, not a list of 2; write 'key: value' lines",
    ),
    "ratio zero": (
        "gear_ratio: 100",
        "gear_ratio: 0",
        ("line 9, joints.1.drive.gear_ratio: is zero; write the value, negative where the motor turns the other way"),
    ),
    "gain zero": (
        "gain: 5",
        "gain: 0",
        "line 9, joints.1.drive.gain: is zero; write the value, negative where the motor turns the other way",
    ),
    "rotor negative": ("1e-4", "-1e-4", "line 9, joints.1.drive.rotor_inertia: -0.0001 is negative; write 0 or more"),
    "damping negative": (
        "damping: 0.5",
        "damping: -0.5",
        "line 10, joints.1.damping: -0.5 is negative; write 0 or more",
    ),
    "friction negative": (
        "damping: 0.5",
        "friction: -0.5",
        "line 10, joints.1.friction: -0.5 is negative; write 0 or more",
    ),
    "mass negative": (
        "mass: 1.5",
        "mass: -1.5",
        "line 14, joints.1.link.inertia.mass: -1.5 is negative; write 0 or more",
    ),
    "mass missing": ("        mass: 1.5\n", "", "line 13, joints.1.link.inertia.mass: is missing; add it"),
    "centre count": (
        "[0.1, 0, 0]",
        "[0.1, 0]",
        (
            "line 15, joints.1.link.inertia.centre_of_mass: 3 numbers are needed, not a list of 2; write a "
            "list of 3 numbers"
        ),
    ),
    "centre text": (
        "[0.1, 0, 0]",
        "[0.1, zero, 0]",
        (
            "line 15, joints.1.link.inertia.centre_of_mass.2: 'zero' is not a number; write one plain "
            "number, without a unit"
        ),
    ),
    "tensor missing": (
        "        about_centre: [0.01, 0, 0, 0.02, 0, 0.03]\n",
        "",
        "line 13, joints.1.link.inertia.about_centre: is missing; add it",
    ),
    "both inertias": (
        "mass: 1.5",
        "parameters: [1, 0, 0, 1, 0, 1, 0, 0, 0, 1]\n        mass: 1.5",
        "line 15, joints.1.link.inertia.mass: 'parameters' states it already; keep one of the two",
    ),
    "ten count": (
        "theta: 0",
        "theta: 0\n    link: {inertia: {parameters: [1, 2]}}",
        (
            "line 22, joints.2.link.inertia.parameters: 10 numbers are needed, not a list of 2; write a list "
            "of 10 numbers"
        ),
    ),
    "joint twice": (
        "name: slide",
        "name: swivel",
        "line 17, joints.2.name: a second joint is called 'swivel'; give each joint a name of its own",
    ),
    "link twice": (
        "theta: 0",
        "theta: 0\n    link: {name: upper}",
        "line 22, joints.2.link.name: a second link is called 'upper'; give each link a name of its own",
    ),
    "tool taken": (
        "{translation",
        "{name: upper, translation",
        "line 22, tool.name: a link or frame is called 'upper' already; choose another name",
    ),
    "gravity": (
        "name: arm",
        "name: arm\ngravity: 9.81",
        "line 2, gravity: 3 numbers are needed, not '9.81'; write a list of 3 numbers",
    ),
    "coupling rows": (
        "[[1, 0], [0.5, 1]]",
        "[[1, 0]]",
        "line 23, coupling: 2 rows are needed, not a list of 1; write 2 lists of 2 numbers",
    ),
    "coupling columns": (
        "[[1, 0], [0.5, 1]]",
        "[[1, 0], [1]]",
        "line 23, coupling.2: 2 numbers are needed, not a list of 1; write a list of 2 numbers",
    ),
    "coupling singular": (
        "[[1, 0], [0.5, 1]]",
        "[[1, 0], [1, 0]]",
        "line 23, coupling: the coupling matrix is singular; write motor speed = coupling @ joint speed",
    ),
    "no joints": (None, "name: a\nconvention: standard\n", "line 1, joints: is missing; add it"),
    "empty joints": (
        None,
        "name: a\nconvention: standard\njoints: []\n",
        "line 3, joints: the list is empty; write one item for each joint",
    ),
    "joints mapping": (
        None,
        "name: a\nconvention: standard\njoints: {a: 1}\n",
        "line 3, joints: a list is needed, not a mapping; write a list",
    ),
    "joint text": (
        None,
        "name: a\nconvention: standard\njoints: [a]\n",
        "line 3, joints.1: a mapping (key: value) is needed, not 'a'; write 'key: value' lines",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_message(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused("bad.yaml", GOOD_DH, CASES[name])


def test_the_good_one_reads(tmp_path: Path) -> None:
    assert_sound(str(tmp_path / "good.yaml"), GOOD_DH)
