"""Free text in the comments of other languages."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from dynident.results.names_in_files import LONGEST_LINE, comment_text


@given(st.text(alphabet="*/ a-\\\n\"'`$é;", max_size=150))
def test_a_comment_ends_nowhere_in_its_text(text: str) -> None:
    found = comment_text(text)
    assert len(found) <= LONGEST_LINE and found.isascii() and found.isprintable()
    assert not {"*/", "/*"} & {found[i : i + 2] for i in range(len(found))}
    assert not set(found) & set("\\\"'`$;")


def test_what_is_harmless_stays_as_it_is() -> None:
    assert comment_text("a / b * c - 0.5, of 'x'") == "a / b * c - 0.5, of _x_"
    assert comment_text("end */ of /* it") == "end __ of __ it"
