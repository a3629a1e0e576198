"""Phrases that must not come back, in messages, help and headings; ``make lint`` runs it.

It looks at the strings of the package that hold more than one word, at templates of the report, the studio and exported
programs, and at headings of the documentation. Docstrings are left out, except those of commands, which become help.
Names in source are for the reviewer's eye. Run: python scripts/words.py
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

#: What must not be read, and the term to use in its place.
PHRASES = {
    r"stands? behind": "physically consistent",
    r"(?:im)?possible (?:robot|bod(?:y|ies)|link)s?": "physically consistent, physically inconsistent",
    r"rows? (?:is|are) worth|worth \d+ independent": "effective sample size",
    r"(?<!-)\b(?:robot|the|its|no|a) descriptions?\b": "robot model",
    r"noisy states": "errors-in-variables bias",
    r"(?:has|have|had) (?:not )?seen": "training range, extrapolation",
    r"certainty \d": "t = ..., or its p-value",
    r"log variance": "residual variance lower by a factor",
    r"flatter": "training metrics are optimistic",
    r"told from|told apart": "significant at 95 %, distinguishable",
    r"width of the sign|sign turns over": "smoothing width of the Coulomb term",
    r"bends over|degressive friction": "sub-linear viscous friction",
    r"friction falls as": "Stribeck effect",
    r"breaks away": "breakaway",
    r"dry friction": "Coulomb friction",
    r"delay of the torque": "time delay between torque and position signals",
    r"\bdoctor\b": "log checks",
    r"believab": "plausible",
    r"\bmend(?:s|ed|ing)?\b": "fix, repair",
    r"\bmakers?\b": "vendor, manufacturer",
    r"robots? that ships?": "built-in example robot",
    r"(?<!dynident )\btriangles?\b(?! inequalit)": "QR factors",
    r"gross errors|have no say": "outliers are rejected",
    r"least squares and its kin": "least-squares variants",
    r"pins? down": "unidentifiable direction",
    r"\bhangs? on\b": "say who does what to what",
    r"\b(?<!there )(?:is|are) none\b": "there is no ...",
    r"what (?:the|no) (?:fit|log) (?:says|has|tells|knows|can)": "data do not speak",
    r"takes off (?:\[|%)": "error reduction [%]",
    r"how far to trust": "diagnostics",
    r"hopeless|\bastray\b": "tracking_error_limit, abort_error_ratio",
    r"\brows (?:a second|kept|at rest|near gaps|dropped)\b|\brows:\.\.\.|--split rows": "samples",
}
#: What whole pages must not have either, code and all.
PAGE_PHRASES = (r"\brobot descriptions?\b", r"\brows (?:a second|kept|at rest|near gaps|dropped)\b", r"--split rows")
_PATTERNS = {re.compile(phrase, re.IGNORECASE): term for phrase, term in PHRASES.items()}


def messages(file: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of each string with a space of a module, docstrings aside; of a command, also its help."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    homes = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef) + (ast.Module,) * (file.parent.name != "cli")
    docs = {id(node.body[0].value) for node in ast.walk(tree)
            if isinstance(node, homes) and node.body and isinstance(node.body[0], ast.Expr)}  # fmt: skip
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and id(node) not in docs
            and " " in node.value
        ):
            yield node.lineno, node.value


def headings(file: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of each heading of a page, code blocks aside."""
    code = False
    for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
        code ^= line.startswith("```")
        if line.startswith("#") and not code:
            yield number, line


def page_lines(file: Path) -> Iterator[tuple[int, str]]:
    """Yield each phrase in the body of a page that no page may have; headings are looked at for all phrases."""
    for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
        if not line.startswith("#"):
            yield from ((number, found.group(0)) for phrase in PAGE_PHRASES for found in re.finditer(phrase, line))


def lines(file: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines of a template, comments of the code aside."""
    for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
        if not line.lstrip().startswith(("//", "/*", "*", "{#")):
            yield number, line


def every_line(file: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines of a program that is written for a user, comments too."""
    yield from enumerate(file.read_text(encoding="utf-8").splitlines(), 1)


def texts(root: Path = ROOT) -> Iterator[tuple[str, int, str]]:
    """Yield all that is looked at: file below the root, line and text."""
    package = root / "src" / "dynident"
    for file in sorted(package.rglob("*")):
        read = {".py": messages, ".html": lines, ".js": lines}.get(file.suffix)
        read = every_line if file.parent.match("exports/templates") else read
        if read:
            yield from ((file.relative_to(root).as_posix(), number, text) for number, text in read(file))
    for file in (root / "README.md", *sorted((root / "docs").rglob("*.md"))):
        for read in (headings, page_lines):
            yield from ((file.relative_to(root).as_posix(), number, text) for number, text in read(file))


def hits(root: Path = ROOT) -> Iterator[str]:
    """Yield the line to print about each phrase."""
    for file, number, text in texts(root):
        for phrase, term in _PATTERNS.items():
            for match in phrase.finditer(text):
                yield f"{file}:{number}: '{match.group(0)}'; write: {term}"


def main() -> int:
    """Print each phrase with its place and the term to use; return 1 where there is one."""
    found = list(hits())
    print("\n".join([*found, f"{len(found)} phrases to replace"]))
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
