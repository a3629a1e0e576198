"""Count words of prose, tables and pictures of each page of the documentation, by kind, as mkdocs.yml lists it.

Prose is what is neither a table, a block of code, a comment nor a picture. The limits: no page above 1,500 words of
prose outside the reference, and a picture on every tutorial and how-to page. `tests/test_documentation_site.py` holds
them.

  python scripts/pages.py           # the pages over a limit, and the sums
  python scripts/pages.py --all     # every page
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MOST_WORDS = 1500
WITH_PICTURES = ("Tutorials", "How to")


@dataclass(frozen=True)
class Page:
    """What a page has: its kind, words of prose, words of tables, and pictures."""

    path: str
    kind: str
    prose: int
    tables: int
    pictures: int

    @property
    def fault(self) -> str:
        """What is against the limits; empty where nothing is."""
        if self.kind != "Reference" and self.prose > MOST_WORDS:
            return f"{self.prose} words of prose, {MOST_WORDS} are the limit"
        if self.kind in WITH_PICTURES and not self.pictures:
            return "no picture"
        return ""


def pages() -> Iterator[Page]:
    """Yield the pages in the order of the navigation."""
    kind = ""
    for line in (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2].splitlines():
        if heading := re.fullmatch(r"  - ([^:]+):", line):
            kind = heading[1]
        elif found := re.search(r"[\w/-]+\.md", line):
            yield page_of(found[0], kind)


def page_of(path: str, kind: str) -> Page:
    """Count a page, given by its path in docs."""
    text = (ROOT / "docs" / path).read_text(encoding="utf-8")
    text = re.sub(r"^ *```.*?^ *```$|<!--.*?-->", "", text, flags=re.MULTILINE | re.DOTALL)
    picture = r"!\[[^\]]*\]\([^)]*\)"
    pictures = len(re.findall(picture, text))
    lines = re.sub(picture, "", text).splitlines()
    tables = [line for line in lines if line.lstrip().startswith("|")]
    prose = [line for line in lines if not line.lstrip().startswith(("|", ":::"))]
    return Page(path, kind, _words(prose), _words(tables), pictures)


def _words(lines: list[str]) -> int:
    text = re.sub(r"\]\([^)]*\)", "]", " ".join(lines))
    return sum(any(letter.isalnum() for letter in word) for word in text.split())


def main() -> int:
    """Print the pages and their sums; 1 where one is over a limit."""
    found = list(pages())
    for page in found:
        if page.fault or "--all" in sys.argv:
            print(f"{page.kind:12} {page.path:42} {page.prose:6} {page.tables:6} {page.pictures:3}  {page.fault}")
    longest = max((page for page in found if page.kind != "Reference"), key=lambda page: page.prose)
    print(
        f"{len(found)} pages, {sum(p.prose for p in found)} words of prose, {sum(p.tables for p in found)} of tables,"
    )
    print(f"{sum(p.pictures for p in found)} pictures; longest outside the reference: {longest.path} ({longest.prose})")
    return int(any(page.fault for page in found))


if __name__ == "__main__":
    raise SystemExit(main())
