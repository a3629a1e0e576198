"""The tables of docs/performance.md, from the files of the rows."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
RESULTS, PAGE = ROOT / "benchmarks/results", ROOT / "docs/performance.md"
BEGIN, END = "<!-- speed: begin (written by python -m benchmarks.speed) -->", "<!-- speed: end -->"

#: Rows in the order of the table.
ROWS = (
    "regressor",
    "identification",
    "long_log",
    "criterion",
    "excitation",
    "figaroh",
    "consistent_fit",
    "colony",
    "simulation",
    "start_up",
    "whole_answer",
)


def write_page() -> None:
    """Write the table anew."""
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}\n\n{block(read_results())}\n{END}{after}", encoding="utf-8")


def read_results() -> list[dict[str, Any]]:
    """Return what the rows have left, in the order of the table."""
    places = [RESULTS / f"{name}.json" for name in ROWS]
    return [json.loads(place.read_text(encoding="utf-8")) for place in places if place.is_file()]


def block(results: list[dict[str, Any]]) -> str:
    """Return what stands between the marks: the table, what was compared, what was missing, the machine."""
    lines = [
        "| work | here | peer | times as fast | least by least | to reach | row |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [_line(result, line) for result in results for line in result["lines"]]
    lines += ["", *(_foot(result) for result in results), "", *_machines(results)]
    return "\n".join(lines) + "\n"


def seconds(value: float) -> str:
    """Return a time with its unit and three digits at most."""
    for size, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "us")):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value * 1e9:.3g} ns"


def reached(line: dict[str, Any]) -> bool | None:
    """Return whether a line reaches what was aimed at; None where nothing was or the peer is missing."""
    if line["reach"] is None or line.get("peer", {}).get("missing"):
        return None
    if "ratio" in line:
        return line["ratio"]["median"] >= line["reach"]
    return line["here"]["median"] <= line["reach"]


def _line(result: dict[str, Any], line: dict[str, Any]) -> str:
    here, peer, aim = line["here"], line.get("peer"), ""
    if line["reach"] is not None:
        word = {True: "yes", False: "**no**", None: "not compared"}[reached(line)]
        aim = f"{line['reach']:g}: {word}" if peer else f"{seconds(line['reach'])}: {word}"
    clock = "" if line["clock"] == "processor" else ", wall clock"
    own = f"{seconds(here['median'])}{clock}"
    if peer is None:
        return f"| {line['work']} | {own} | | | | {aim} | `{result['row']}` |"
    if peer.get("missing"):
        return f"| {line['work']} | {own} | {peer['name']}: not installed | | | {aim} | `{result['row']}` |"
    ratio = line["ratio"]
    spread = f"{ratio['median']:.3g} ({ratio['lower']:.3g} to {ratio['upper']:.3g})"
    least = f"{peer['least'] / here['least']:.3g}"
    other = f"{peer['name']}: {seconds(peer['median'])}"
    return f"| {line['work']} | {own} | {other} | {spread} | {least} | {aim} | `{result['row']}` |"


def _foot(result: dict[str, Any]) -> str:
    checks = "; ".join(f"{c['what']} {c['apart']:.2g}" for c in result["checks"])
    repeats = {line["repeats"] for line in result["lines"]}
    missing = "".join(f" Missing: {name} ({why})." for name, why in result["missing"].items())
    compared = f" Compared: {checks}." if checks else ""
    return f"- `{result['row']}`: {result['about']}; {max(repeats)} repeats.{compared}{missing}"


def _machines(results: list[dict[str, Any]]) -> list[str]:
    """Return one line for each machine and set of versions that the files name."""
    found: dict[str, tuple[list[str], list[float]]] = {}
    for result in results:
        m = result["machine"]
        versions = ", ".join(f"{name} {version}" for name, version in m["versions"].items() if name != "dynident")
        told = f"{m['processor']}, {m['cores']} cores, {m['memory_gib']:g} GiB, {m['system']}, Python {m['python']}"
        rows, loads = found.setdefault(f"{told}, {versions}, {'; '.join(m['blas'])}", ([], []))
        rows.append(result["row"])
        loads += [m["load_before"][0], m["load_after"]]
    return [
        f"Machine of {', '.join(f'`{row}`' for row in rows)}: {told}; one BLAS thread; load average "
        f"{min(loads):.1f} to {max(loads):.1f}."
        for told, (rows, loads) in found.items()
    ]
