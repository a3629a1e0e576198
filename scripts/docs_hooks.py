"""What the pages of docs/ need before MkDocs reads them."""

import re
from typing import Any

#: A fence whose first line has marks for tests/test_documentation.py behind the language.
_MARKED = re.compile(r"^(```\w+) [^\n`]+$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Take the marks away: they say how a block is tested, which no reader needs."""
    return _MARKED.sub(r"\1", markdown)
