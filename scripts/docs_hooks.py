"""What the pages of docs/ need before MkDocs reads them, and what must not be in them afterwards."""

import re
from typing import Any

from mkdocs.exceptions import PluginError

#: A fence whose first line has marks for tests/test_documentation.py behind the language.
_MARKED = re.compile(r"^(```\w+) [^\n`]+$", re.MULTILINE)

#: Something that a browser would fetch by itself from another host.
_FETCHED = re.compile(r"<(?:script|img|iframe|link|source)\b[^>]*\b(?:src|href)=[\"']?(?:https?:)?//[^\s\"'>]+")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Take the marks away: they say how a block is tested, which no reader needs."""
    return _MARKED.sub(r"\1", markdown)


def on_post_page(output: str, page: Any, **_: Any) -> str:
    """Refuse a page that asks another host for anything: the site opens offline."""
    if found := _FETCHED.search(output):
        raise PluginError(f"{page.file.src_uri}: {found[0]} is fetched from another host; ship it with the pages")
    return output
