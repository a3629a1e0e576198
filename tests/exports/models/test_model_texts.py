"""Texts of exported models: rotations at every orientation, formulas of spreadsheets, signs of LaTeX, edits of XML."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident.exports.models.csv import text
from dynident.exports.models.latex import escaped, share
from dynident.exports.models.writing.xml_edit import (
    elements,
    quaternion,
    roll_pitch_yaw,
    with_attributes,
    without_elements,
)
from dynident.robot_files.rotations import rotation_from_rpy

ANGLE = st.one_of(st.floats(-np.pi, np.pi), st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi, 1.5708, -1.5708]))


@given(ANGLE, ANGLE, ANGLE)
def test_rotations_come_back_from_their_texts(roll: float, pitch: float, yaw: float) -> None:
    """Also where pitch is a right angle, to rounding; pi / 2 as URDFs write it is near one and not one."""
    rotation = rotation_from_rpy([roll, pitch, yaw])
    np.testing.assert_allclose(rotation_from_rpy(roll_pitch_yaw(rotation)), rotation, atol=5e-15)
    w, x, y, z = quaternion(rotation)
    again = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    np.testing.assert_allclose(again, rotation, atol=5e-15)


@pytest.mark.parametrize("word", ["=1+1", "+1", "-1", "@sum", "\t=1", "\r=1"])
def test_no_text_begins_a_formula(word: str) -> None:
    assert text(word) == f"'{word}" and text("Izz[link]") == "Izz[link]"


def test_latex_prints_every_sign_of_ascii_and_runs_none() -> None:
    found = escaped("".join(map(chr, range(32, 127))) + "\n\u00fc")
    for sign in "#$%&_{}":
        assert f"\\{sign}" in found
    assert found.endswith("??") and "\\textbackslash{}" in found and "\n" not in found


def test_attributes_are_set_in_place_and_names_inside_values_are_left_alone() -> None:
    data = b"<a><b note=\"damping='3' x\" damping = '9'  k='v' /></a>"
    edit = with_attributes(data, elements("", data).children[0], {"damping": "1.5", "friction": "2.0"})
    after = data[: edit.start] + edit.text + data[edit.end :]
    assert after == b"<a><b note=\"damping='3' x\" damping = '1.5'  k='v' friction=\"2.0\" /></a>"


def test_elements_are_found_past_comments_and_unread_sections() -> None:
    data = "<a><!-- <b>--><![CDATA[<b/>]]><b t='>'><c/>é</b><?b x?></a>".encode()
    (found,) = elements("", data).children
    assert data[found.start : found.end] == "<b t='>'><c/>é</b>".encode()
    assert without_elements(data, ("c",)) == data.replace(b"<c/>", b"")


def test_latex_prints_a_quote_without_a_package() -> None:
    assert escaped('a"b') == r"a\texttt{\char34}b"  # \textquotedbl is not there in the encoding that LaTeX starts with


@pytest.mark.parametrize(
    ("relative", "words"),
    [(5.51, "551"), (0.04, "4.0"), (0.0061, "0.61"), (0.55, "55"), (1e-6, "$<0.01$"), (50.0, "$>999$")],
)
def test_latex_prints_shares_as_the_tables_do(relative: float, words: str) -> None:
    assert share(relative) == rf"{words}\,\%"


def test_latex_prints_no_share_of_nothing() -> None:
    assert share(float("nan")) == "--" and share(float("inf")) == "--"
