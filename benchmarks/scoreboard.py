"""Tables of docs/benchmark.md from docs/assets/scoreboard.json, which 'dynident benchmark --real ... --json' prints.

Run: python -m benchmarks.scoreboard [--json FILE] [--write FILE]; without --write the tables are printed.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dynident.files import write_atomically

DOCS = Path(__file__).resolve().parent.parent / "docs"

BEGIN, END = "<!-- scoreboard: begin (written by python -m benchmarks.scoreboard) -->", "<!-- scoreboard: end -->"

#: Sets beside each other in one table.
ABREAST = 4

Result = Mapping[str, Any]


def percent(share: float | None) -> str:
    """Return a share in percent with three digits; nothing where there is none."""
    return "" if share is None else f"{100 * share:.3g}"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def held_out(board: Mapping[str, Any]) -> str:
    """Return the held-out error of every method on every set; failures are letters with their reasons below."""
    sets = [each for each in board["sets"] if each["methods"]]
    by_set = [{result["method"]: result for result in each["methods"]} for each in sets]
    methods = list(dict.fromkeys(name for found in by_set for name in found))
    reasons: dict[str, str] = {}

    def cell(result: Result | None, best: float) -> str:
        if result is None:
            return ""
        if result.get("failure"):
            return reasons.setdefault(result["failure"], f"({len(reasons) + 1})")
        error = percent(result["test_error"])
        star = "" if result["physically_consistent"] else "\\*"
        return f"**{error}**{star}" if result["test_error"] == best else error + star

    tables = []
    for start in range(0, len(sets), ABREAST):
        part = by_set[start : start + ABREAST]
        best = [min(r["test_error"] for r in found.values() if not r.get("failure")) for found in part]
        rows = [
            [f"`{method}`", *(cell(found.get(method), least) for found, least in zip(part, best, strict=True))]
            for method in methods
        ]
        tables.append(table(["method", *(each["name"] for each in sets[start : start + ABREAST])], rows))
    text = "\n\n".join(tables)
    notes = "\n".join(f"- {mark} {why}" for why, mark in reasons.items())
    return f"{text}\n\n{notes}" if notes else text


def beside_published(board: Mapping[str, Any]) -> str:
    """Return our best, weighted and consistent fit of each set that others have published figures of, and theirs."""
    rows = []
    for each in board["sets"]:
        good = sorted((r for r in each["methods"] if not r.get("failure")), key=lambda r: r["test_error"])
        if not good or not each["published"]:
            continue
        for result in [good[0], *(r for r in good[1:] if r["method"] in ("wls", "consistent"))]:
            spread = " ".join(f"{joint['rmse_unfiltered']:.3g}" for joint in result["joints"])
            errors = (percent(result["test_error"]), percent(result["training_error"]))
            rows.append([each["name"], f"`{result['method']}`", *errors, spread, ""])
        for figure in each["published"]:
            spread = " ".join(f"{value:.3g}" for value in figure["rmse_unfiltered"])
            errors = (percent(figure["test_error"]), percent(figure["training_error"]))
            rows.append([each["name"], f"{figure['who']} ({figure['source']})", *errors, spread, figure["remark"]])
    head = ["set", "who", "held-out error [%]", "training error [%]", "RMSE by joint, unfiltered", "remark"]
    return table(head, rows)


def block(board: Mapping[str, Any]) -> str:
    """Return what stands between the marks of the page."""
    return f"{held_out(board)}\n\nBeside what others have published of the same sets:\n\n{beside_published(board)}"


def main() -> None:
    """Print the tables, or write them into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", default=str(DOCS / "assets" / "scoreboard.json"), metavar="FILE")
    parser.add_argument("--write", metavar="FILE", help="the page whose tables are replaced")
    options = parser.parse_args()
    board = json.loads(Path(options.json).read_text(encoding="utf-8"))
    text = block(board)
    if options.write is None:
        print(text)
        return
    page = Path(options.write)
    before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    if not rest or not after:
        parser.error(f"{page} has no lines '{BEGIN}' and '{END}'")
    write_atomically(page, f"{before}{BEGIN}\n\n{text}\n\n{END}{after}")


if __name__ == "__main__":
    main()
