"""Which small faults would no test notice? Draws mutants of files and runs the tests that take their lines.

A mutant is the package with one comparison, sign, number, branch, bound or call changed; annotations, decorators and
the texts of errors are left alone. The tests are those that took the line in `make coverage`, which has to be run
before, fastest first until they have lasted --limit seconds there. Each mutant runs in a fork that imports the package
with the changed file. Results go to build/mutants.jsonl; what stands there is not run again.
Run: python scripts/mutants.py --draw 50 --seed 1 model/base_parameters.py identification/uncertainty
"""

import argparse
import ast
import importlib.machinery
import importlib.util
import json
import os
import random
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import coverage
import pytest

ROOT = Path(__file__).resolve().parent.parent
SOURCE, PLACE, RESULTS = ROOT / "src" / "dynident", ROOT / "build" / "branches", ROOT / "build" / "mutants.jsonl"
#: Modules of others that forks share.
SHARED = ("numpy", "scipy.linalg", "scipy.signal", "scipy.optimize", "numba", "clarabel", "yaml")
COMPARED: dict[type, tuple[type, ...]] = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE), ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
}  # fmt: skip
REPLACED: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
_PAIRS = "min max,any all,zeros ones,zeros_like ones_like,maximum minimum,sum mean,triu tril,argmax argmin,floor ceil"
NAMES = {a: b for pair in _PAIRS.split(",") for a, b in (pair.split(), pair.split()[::-1])}


class Mutator(ast.NodeTransformer):
    """Lists the mutants of a tree in ``places``, as line and words, and makes the one of a number.

    Args:
        wanted: Its number; -1: none.
    """

    def __init__(self, wanted: int = -1) -> None:
        self._wanted = wanted
        self.places: list[tuple[int, str]] = []

    def _offer(self, node: Any, what: str, change: Callable[[], ast.AST]) -> Any:
        self.places.append((node.lineno, what))
        return change() if len(self.places) - 1 == self._wanted else node

    def _with(self, node: Any, what: str, **changed: Any) -> Any:
        return self._offer(node, what, lambda: type(node)(**{**dict(ast.iter_fields(node)), **changed}))

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Change defaults and body."""
        node.args.defaults = [self.visit(value) for value in node.args.defaults]
        node.args.kw_defaults = [value and self.visit(value) for value in node.args.kw_defaults]
        return self.visit_ClassDef(node)

    def visit_ClassDef(self, node: Any) -> ast.AST:
        """Change the body."""
        node.body = [self.visit(line) for line in node.body]
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        """Change the value."""
        node.value = node.value and self.visit(node.value)
        return node

    def visit_Raise(self, node: ast.Raise) -> ast.AST:
        """Leave errors alone."""
        return node

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.AST:
        """Leave texts alone."""
        return node

    def visit_Expr(self, node: ast.Expr) -> ast.AST:
        """Leave a call out."""
        if not isinstance(node.value, ast.Call):
            return node
        self.generic_visit(node)
        return self._offer(node, "call left out", ast.Pass)

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        """Put a neighbour or the opposite in the place of a comparison."""
        self.generic_visit(node)
        found = node
        for other in COMPARED[type(node.ops[0])]:
            what = f"{type(node.ops[0]).__name__} to {other.__name__}"
            made = self._with(node, what, ops=[other(), *node.ops[1:]])
            found = made if made is not node else found
        return found

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """Put the opposite in the place of an operator."""
        self.generic_visit(node)
        other = REPLACED.get(type(node.op))
        texts = any(isinstance(side, ast.Constant | ast.JoinedStr) for side in (node.left, node.right))
        if other is None or (texts and isinstance(node.op, ast.Add | ast.Mod) and _is_text(node)):
            return node
        return self._with(node, f"{type(node.op).__name__} to {other.__name__}", op=other())

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.AST:
        """Put the opposite in the place of an operator."""
        self.generic_visit(node)
        other = REPLACED.get(type(node.op))
        return node if other is None else self._with(node, f"{type(node.op).__name__}= to {other.__name__}", op=other())

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        """Take and for or."""
        self.generic_visit(node)
        other = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        return self._with(node, f"{type(node.op).__name__} to {type(other).__name__}", op=other)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        """Drop a sign or a not."""
        self.generic_visit(node)
        return self._offer(node, f"{type(node.op).__name__} left out", lambda: node.operand)

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        """Turn a truth value over, add one to a whole number, double another."""
        value = node.value
        if isinstance(value, bool):
            return self._with(node, f"{value} to {not value}", value=not value)
        if isinstance(value, int | float):
            other = value + 1 if isinstance(value, int) else 2 * value or 1.0
            return self._with(node, f"{value} to {other}", value=other)
        return node

    def visit_If(self, node: ast.If) -> ast.AST:
        """Turn a condition over."""
        self.generic_visit(node)
        return self._with(node, "if to if not", test=ast.UnaryOp(ast.Not(), node.test))

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        """Swap the two values."""
        self.generic_visit(node)
        return self._with(node, "other value", body=node.orelse, orelse=node.body)

    def visit_Break(self, node: ast.Break) -> ast.AST:
        """Go on."""
        return self._offer(node, "break to continue", ast.Continue)

    def visit_Continue(self, node: ast.Continue) -> ast.AST:
        """End the loop."""
        return self._offer(node, "continue to break", ast.Break)

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """Take the other one of a pair of functions."""
        self.generic_visit(node)
        other = NAMES.get(node.attr)
        return node if other is None else self._with(node, f"{node.attr} to {other}", attr=other)

    def visit_Name(self, node: ast.Name) -> ast.AST:
        """Take the other one of a pair of functions."""
        other = NAMES.get(node.id)
        return node if other is None else self._with(node, f"{node.id} to {other}", id=other)


def _is_text(node: ast.BinOp) -> bool:
    sides = (node.left, node.right)
    return any(isinstance(s, ast.JoinedStr) or isinstance(getattr(s, "value", None), str) for s in sides)


def mutants(file: Path) -> list[tuple[int, str]]:
    """Return line and words of all mutants of a file."""
    mutator = Mutator()
    mutator.visit(ast.parse(file.read_text()))
    return mutator.places


class Tests:
    """Which tests take which lines, from the data of `make coverage`."""

    def __init__(self) -> None:
        self._data = coverage.CoverageData(str(PLACE / "all.data"))
        self._data.read()
        self._files = {Path(file).resolve(): file for file in self._data.measured_files()}
        self._named: dict[str, tuple[str, float]] = {}
        for report in PLACE.glob("*.xml"):
            for case in ElementTree.parse(report).iter("testcase"):
                module, name = case.get("classname", ""), case.get("name", "").partition("[")[0]
                place = f"{module.replace('.', '/')}.py::{name}"
                short = f"{module.rpartition('.')[2]}.{name}"
                self._named[short] = (place, self._named.get(short, (place, 0.0))[1] + float(case.get("time", 0.0)))

    def of(self, file: Path, line: int, limit: float) -> list[str]:
        """Return tests that took a line, fastest first, within a time.

        Of a line that no test takes by itself, such as one of an import, they are those of the nearest line above it,
        at most eight away, or of the file.
        """
        lines = self._data.contexts_by_lineno(self._files[file]) if file in self._files else {}
        places = [lines.get(near, []) for near in range(line, max(line - 9, 0), -1)]
        places.append([test for tests in lines.values() for test in tests])
        total, chosen = 0.0, []
        for known in places:
            for place, seconds in sorted(
                {self._named[test] for test in known if test in self._named}, key=lambda t: t[1]
            ):
                total += seconds
                if chosen and total > limit:
                    return chosen
                chosen.append(place)
            if chosen:
                break
        return chosen


class Changed(importlib.machinery.SourceFileLoader):
    """Finds and loads one module of the package from a changed tree."""

    def __init__(self, file: Path, tree: ast.Module) -> None:
        parts = file.relative_to(SOURCE.parent).with_suffix("").parts
        self._places = [str(file.parent)] if parts[-1] == "__init__" else None
        super().__init__(".".join(parts[:-1] if self._places else parts), str(file))
        self._tree = tree

    def find_spec(self, name: str, path: object = None, target: object = None) -> Any:
        """Return where the module comes from; None for any other."""
        if name != self.name:
            return None
        places = self._places
        return importlib.util.spec_from_file_location(name, self.path, loader=self, submodule_search_locations=places)

    def get_code(self, fullname: str) -> Any:
        """Return the code of the changed tree."""
        return compile(self._tree, self.path, "exec")


def run(file: Path, number: int, tests: list[str], seconds: int, report: int) -> None:
    """Run tests with a mutant; write "survived" or what failed into a pipe. For a fork: never returns."""
    with (PLACE / "mutants.log").open("a") as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 2))
    resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
    tree = ast.fix_missing_locations(Mutator(number).visit(ast.parse(file.read_text())))
    sys.meta_path.insert(0, Changed(file, tree))
    sys.path.insert(0, str(ROOT / "src"))
    said = Failures()
    code = pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", "not battery", *tests], [said])
    os.write(report, ("survived" if code == 0 else said.first or f"exit {code}").encode())
    os._exit(0)


class Failures:
    """Keeps the name of the first test that fails."""

    first = ""

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note a test that failed."""
        self.first = self.first or (report.nodeid if report.failed else "")

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Note a file that could not be imported."""
        self.first = self.first or (f"import of {report.nodeid}" if report.failed else "")


def outcome(file: Path, number: int, tests: list[str], limit: float) -> str:
    """Return what kills a mutant, or "survived"."""
    if not tests:
        return "survived: no test takes it"
    seconds = int(20 + 10 * limit)
    ours, theirs = os.pipe()
    child = os.fork()
    if not child:
        try:
            os.close(ours)
            run(file, number, tests, seconds, theirs)
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(3)
    os.close(theirs)
    end, done = time.monotonic() + 15 * seconds, 0
    while not done and time.monotonic() < end:
        time.sleep(0.02)
        done, _ = os.waitpid(child, os.WNOHANG)
    if not done:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    with os.fdopen(ours) as pipe:
        return pipe.read() or "ended, out of time or of memory"


def chosen(words: list[str]) -> Iterator[Path]:
    """Yield the files of the package that are named, and those of named folders."""
    for word in words:
        place = SOURCE / word
        yield from sorted(place.rglob("*.py")) if place.is_dir() else [place]


def main() -> None:
    """Draw mutants, run those that were not, and print how many were killed, and the others."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", help="files or folders of src/dynident")
    parser.add_argument("--draw", type=int, default=50, help="mutants, of all files together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--limit", type=float, default=3.0, help="seconds of tests for each, as `make coverage` timed them"
    )
    options = parser.parse_args()
    every = [(file, number, *place) for file in chosen(options.files) for number, place in enumerate(mutants(file))]
    drawn = random.Random(options.seed).sample(every, min(options.draw, len(every)))
    known = [json.loads(line) for line in RESULTS.read_text().splitlines()] if RESULTS.exists() else []
    done = {(one["file"], one["line"], one["what"], one["number"]): one["by"] for one in known}
    tests = Tests()
    for name in SHARED:
        importlib.import_module(name)
    os.chdir(ROOT)
    file, _, line, _ = drawn[0]
    plain = outcome(file, -1, tests.of(file, line, options.limit), options.limit)
    if not plain.startswith("survived"):
        sys.exit(f"without any change of {file} this fails: {plain}")
    counts: dict[str, list[int]] = {}
    for file, number, line, what in drawn:
        name = str(file.relative_to(SOURCE))
        by = done.get((name, line, what, number)) or outcome(
            file, number, tests.of(file, line, options.limit), options.limit
        )
        with RESULTS.open("a") as results:
            results.write(json.dumps({"file": name, "line": line, "what": what, "number": number, "by": by}) + "\n")
        count = counts.setdefault(str(Path(name).parent), [0, 0])
        count[0] += 1
        count[1] += not by.startswith("survived")
        if by.startswith("survived"):
            print(f"{name}:{line}: {what}: {file.read_text().splitlines()[line - 1].strip()}", flush=True)
    for part, (number, killed) in sorted(counts.items()):
        print(f"| `{part}` | {number} | {killed} |")
    print(f"{sum(k for _, k in counts.values())} of {len(drawn)} killed, drawn from {len(every)}")


if __name__ == "__main__":
    main()
