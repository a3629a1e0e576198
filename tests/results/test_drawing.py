"""SVG text: escaping, paths with breaks, and the rows of a line that are kept."""

from __future__ import annotations

import numpy as np
import pytest
from drawings import parsed, points
from hypothesis import given
from hypothesis import strategies as st
from synthetic import HOSTILE

from dynident.results.figures import svg
from dynident.results.text import label


@pytest.mark.parametrize("name", HOSTILE)
def test_text_is_only_text(name: str) -> None:
    drawing = svg.drawing(10, 10, svg.words(name, 0, 0, full=name), name, name)
    root = parsed(drawing)
    assert [child.tag.split("}")[1] for child in root.iter()] == ["svg", "title", "desc", "text"] + ["title"] * bool(
        name
    )
    assert root[0].text == label(name)
    assert "\x00" not in drawing


def test_numbers_keep_a_tenth() -> None:
    assert [svg.number(v) for v in (1.0, 2.04999, -0.01, 12.35, 1e5)] == ["1", "2", "0", "12.3", "100000"]
    assert svg.element("a", attributes={"b-c": 1.26, "class": "x<"}) == '<a b-c="1.3" class="x&lt;"/>'


def test_a_track_breaks_where_a_point_is_missing() -> None:
    x = np.arange(7.0)
    y = np.array([np.nan, 1, 2, np.inf, 3, np.nan, 4])
    assert svg.track(x, y) == "M1 1 2 2M4 3M6 4"
    assert svg.track(np.zeros(0), np.zeros(0)) == ""
    assert svg.stroke("", 1) == ""


@given(st.integers(0, 400), st.integers(0, 10_000), st.booleans())
def test_kept_rows_hold_the_extremes_of_every_stretch(count: int, seed: int, gaps: bool) -> None:
    generator = np.random.default_rng(seed)
    x = np.sort(generator.uniform(0, 20, count))
    y = generator.normal(size=count)
    if gaps:
        y[generator.uniform(size=count) < 0.1] = np.nan
    kept = svg.kept_rows(x, y, bucket=1.0)
    assert np.all(np.diff(kept) > 0)
    if count < 4 or count <= 2 * (x[-1] - x[0]):
        assert kept.tolist() == list(range(count))
        return
    assert len(kept) <= 2 * 21 + 2
    stretch = np.floor(x - x[0])
    for number in np.unique(stretch):
        own = y[stretch == number]
        if np.isfinite(own).any():
            shown = y[kept[stretch[kept] == number]]
            assert np.nanmin(own) in shown and np.nanmax(own) in shown


def test_a_long_line_is_short_on_the_page() -> None:
    x = np.linspace(0, 420, 200_000)
    rows = svg.kept_rows(x, np.sin(x / 10) + np.random.default_rng(0).normal(size=len(x)))
    assert len(rows) <= 2 * 842
    (stretch,) = points(svg.track(x[rows], 100 * np.sin(x[rows] / 10)))
    assert len(stretch) == len(rows)


def test_a_figure_has_the_same_text_every_time() -> None:
    first, second = (svg.drawing(10, 10, "<g/>", "a", "b") for _ in range(2))
    assert first == second
    assert first != svg.drawing(10, 10, "<g/>", "a", "c")
