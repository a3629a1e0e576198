"""Which lines and branches of the package do the tests take? Into docs/assets/branches.json and docs/laws.md.

The whole default suite runs under coverage.py in parts, each in a process of its own; then the tests of ``INTERPRETED``
with numba off, since machine code cannot be traced: they take the compiled functions as Python. What other processes
run is not counted. A part is kept in build/branches until the package or its tests change, so that a run that was
stopped goes on. Run: make coverage; what no test takes: python scripts/branches.py --missing identification/search
"""

import argparse
import hashlib
import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import coverage

ROOT = Path(__file__).resolve().parent.parent
PLACE = ROOT / "build" / "branches"
FIGURES = ROOT / "docs" / "assets" / "branches.json"
PAGE = ROOT / "docs" / "laws.md"
BEGIN, END = "<!-- branches: begin (written by make coverage) -->", "<!-- branches: end -->"
#: The core: what stands between a description and a log on one side and an estimate on the other.
CORE = ("model", "data", "identification")
#: Files of tests a part has at most.
FILES = 10
#: What is counted of the tests.
OUTCOMES = ("tests", "skipped", "failures", "errors")
#: Tests that also run compiled functions as Python: those that need few steps of them.
INTERPRETED = tuple(
    f"tests/{file}::{test}"
    for file, tests in {
        "model/kernels/test_batched.py": (
            "test_dynamics_agree_with_pinocchio",
            "test_torque_is_linear_in_any_parameters",
            "test_mimic_joints_carry_the_torques_of_all_their_links",
        ),
        "model/kernels/test_joint_columns.py": (
            "test_blocks_are_the_columns_of_the_regressor",
            "test_mimic_joints_sum_their_links",
        ),
        "data/test_zero_phase.py": (
            "test_it_is_the_filter_of_scipy",
            "test_what_is_not_finite_stays_in_its_own_signal",
        ),
        "data/test_smoothers.py": (
            "test_the_smoother_is_the_dense_least_squares_of_its_model_on_uneven_steps",
            "test_the_likelihood_is_largest_near_the_truth",
        ),
        "excitation/test_clearance.py": (
            "test_half_spaces_and_the_region_are_closed_forms",
            "test_parallel_and_crossing_segments",
            "test_the_bound_is_reached_by_an_arm_that_is_stretched_out",
        ),
        "simulation/test_virtual_robot.py": (
            "test_the_compiled_loop_is_the_plain_loop",
            "test_torques_stop_at_the_effort_limits",
        ),
        "simulation/test_virtual_cell.py": (
            "test_friction_fades_with_the_temperature",
            "test_a_cascade_is_its_loops",
            "test_a_delayed_torque_through_a_lagging_current_loop_is_that_of_the_law",
            "test_computed_torque_is_the_inverse_dynamics_of_what_is_believed",
            "test_an_integral_brings_the_arm_to_its_place_and_rests_at_the_limit",
        ),
        "identification/test_recursive.py": (
            "test_forgetting_weighs_samples_as_written_out",
            "test_rows_one_by_one_and_at_once_are_the_same",
            "test_a_window_is_least_squares_over_its_rows",
            "test_a_row_that_decides_nearly_all_leaves_and_the_rest_is_built_anew",
        ),
        "identification/test_swarm.py": (
            "test_a_search_takes_the_path_of_a_plain_loop",
            "test_three_others_are_three_others",
            "test_tournaments_are_won_by_the_better",
            "test_children_and_mutants_keep_to_the_box",
        ),
        "identification/test_simulating_limits.py": ("test_few_implicit_steps_find_what_explicit_ones_find",),
        "identification/test_abc.py": ("test_the_compiled_colony_is_the_plain_one",),
    }.items()
    for test in tests
)


@dataclass(frozen=True)
class Part:
    """Some files of tests, run in one process."""

    name: str
    tests: tuple[str, ...]
    interpreted: bool = False

    def data(self, sources: str) -> Path:
        """Return the file of what was taken, named after the contents of package and tests."""
        files = {ROOT / test.partition("::")[0] for test in self.tests}
        files |= {file for file in ROOT.glob("tests/**/*.py") if not file.name.startswith("test_")}
        return PLACE / f"{self.name}-{digest(files, sources)}.data"

    def run(self, sources: str) -> dict[str, int]:
        """Run the tests unless they have passed before; return their report."""
        data = self.data(sources)
        passed, report = data.with_suffix(".xml"), data.with_suffix(".part")
        if passed.exists():
            return _figures(passed)
        for old in PLACE.glob(f"{self.name}-????????????.*"):
            old.unlink()
        chosen = ["-q", "-p", "no:cacheprovider", "-m", "not battery", f"--junitxml={report}", *self.tests]
        command = [sys.executable, "-m", "coverage", "run", f"--data-file={data}", "-m", "pytest", *chosen]
        switch = {"NUMBA_DISABLE_JIT": "1"} if self.interpreted else {}
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", **switch}
        with data.with_suffix(".txt").open("w") as said:
            subprocess.run(command, cwd=ROOT, env=environment, stdout=said, stderr=said, check=False)
        found = _figures(report)
        return found if found["failures"] or found["errors"] else _figures(report.replace(passed))


def _figures(report: Path) -> dict[str, int]:
    """Return how many tests a report in the format of JUnit has, and how they ended."""
    suite = ElementTree.parse(report).getroot()[0]
    return {what: int(suite.attrib[what]) for what in OUTCOMES}


def parts() -> Iterator[Part]:
    """Yield the default suite, folder by folder, and the tests that run without numba."""
    folders = {file.parent for file in (ROOT / "tests").rglob("test_*.py")}
    for folder in sorted(
        folders,
        key=lambda folder: (folder.relative_to(ROOT / "tests").parts[:1] not in {(wing,) for wing in CORE}, folder),
    ):
        files = sorted(str(file.relative_to(ROOT)) for file in folder.glob("test_*.py"))
        name = "-".join(folder.relative_to(ROOT).parts)
        for start in range(0, len(files), FILES):
            yield Part(f"{name}-{start // FILES + 1}", tuple(files[start : start + FILES]))
    if INTERPRETED:
        yield Part("interpreted", INTERPRETED, interpreted=True)


def digest(files: Iterable[Path], more: str = "") -> str:
    """Return twelve digits that change with any of the files."""
    total = hashlib.sha256(more.encode())
    for file in sorted(files):
        total.update(file.read_bytes())
    return total.hexdigest()[:12]


def taken(files: Iterable[Path]) -> dict[str, dict]:
    """Return what coverage.py says of each file of the package, all parts together."""
    total = coverage.Coverage(data_file=str(PLACE / "all.data"), config_file=str(ROOT / "pyproject.toml"))
    total.combine([str(file) for file in files], keep=True)
    total.json_report(outfile=str(PLACE / "all.json"))
    report = json.loads((PLACE / "all.json").read_text())["files"]
    return {name.partition("src/dynident/")[2]: said for name, said in sorted(report.items())}


def packages(files: dict[str, dict]) -> dict[str, dict[str, int]]:
    """Return the sums of the wings and of the folders and files of the core."""
    sums: dict[str, dict[str, int]] = {}
    for name, said in files.items():
        wing, *inner = name.split("/")
        owners = [wing if inner else "ground"]
        if wing in CORE:
            owners.append(f"{wing}/{inner[0] if len(inner) > 1 else '*.py'}")
        for owner in owners:
            into = sums.setdefault(owner, dict.fromkeys(("lines", "lines_taken", "branches", "branches_taken"), 0))
            found = said["summary"]
            into["lines"] += found["num_statements"]
            into["lines_taken"] += found["covered_lines"]
            into["branches"] += found["num_branches"]
            into["branches_taken"] += found["covered_branches"]
    return dict(sorted(sums.items()))


def table(facts: dict) -> str:
    """Return the figures as Markdown: the core by its folders, then the rest."""
    rows = ["| part | lines | branches |", "|---|---|---|"]
    order = sorted(facts["packages"], key=lambda name: (name.partition("/")[0] not in CORE, name))
    for name in order:
        values = facts["packages"][name]
        cells = [f"`{name}`" if "/" in name or name == "ground" else f"**`{name}`**"]
        for what in ("lines", "branches"):
            of, has = values[what], values[f"{what}_taken"]
            cells.append(f"{has} of {of}, {100 * has / max(of, 1):.1f} %" if of else "none")
        rows.append(f"| {' | '.join(cells)} |")
    made = f"{facts['tests']} tests at {facts['commit']}, {facts['skipped']} of them skipped"
    made += f", coverage.py {facts['coverage']}, Python {facts['python']}"
    if facts["left_out"]:
        made += f"; not run: {', '.join(name.removeprefix('tests-') for name in facts['left_out'])}"
    return "\n".join([f"{made}:", "", *rows])


def missing(files: dict[str, dict], word: str) -> None:
    """Print the lines and branches that no test took in the files whose name holds a word."""
    for name, said in files.items():
        lines, arcs = said["missing_lines"], said["missing_branches"]
        if word in name and (lines or arcs):
            between = [f"{a}->{'end' if b < 0 else b}" for a, b in arcs if a not in lines and b not in lines]
            print(
                f"{name}: lines {' '.join(map(str, lines)) or 'all taken'}; branches {' '.join(between) or 'all taken'}"
            )


def main() -> int:
    """Run what has to be run, and write the figures where all tests passed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="parts at a time")
    parser.add_argument("--only", metavar="WORD", default="", help="run parts named so, and write no figures")
    parser.add_argument("--count", action="store_true", help="run nothing, count the parts that stand, name the others")
    parser.add_argument("--missing", metavar="WORD", help="print what was not taken in files named so, and run nothing")
    options = parser.parse_args()
    PLACE.mkdir(parents=True, exist_ok=True)
    sources = digest([*(ROOT / "src").rglob("*.py"), ROOT / "pyproject.toml"])
    chosen = [part for part in parts() if options.only in part.name]
    if options.missing is not None:
        missing(
            taken(file for part in chosen if (file := part.data(sources)).with_suffix(".xml").exists()), options.missing
        )
        return 0
    standing = [part for part in chosen if part.data(sources).with_suffix(".xml").exists()]
    left_out = [part.name for part in chosen if part not in standing] if options.count else []
    chosen = standing if options.count else chosen
    counts = dict.fromkeys(OUTCOMES, 0)
    with ThreadPoolExecutor(options.jobs) as pool:
        for part, report in zip(chosen, pool.map(lambda part: part.run(sources), chosen), strict=True):
            for what in counts:
                counts[what] += report[what]
            print(part.name, *(f"{number} {what}" for what, number in report.items()), flush=True)
    if options.only:
        return 0
    files = taken(part.data(sources) for part in chosen)
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    facts = {"commit": commit.stdout.strip(), "coverage": coverage.__version__, "python": platform.python_version()}
    facts |= {**counts, "left_out": left_out, "packages": packages(files)}
    passed = not counts["failures"] + counts["errors"]
    if passed:
        FIGURES.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
        before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
        PAGE.write_text(f"{before}{BEGIN}\n\n{table(facts)}\n\n{END}{rest.partition(END)[2]}", encoding="utf-8")
    print(table(facts))
    return int(not passed)


if __name__ == "__main__":
    sys.exit(main())
