"""README and docs state facts beside their blocks: families, orders, environment variables, links, the licence."""

from __future__ import annotations

import hashlib
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
import yaml

from contracts.families import FAMILIES
from dynident.cli.main import main
from dynident.model.inertia import TEN, Inertia
from dynident.model.parameters import to_mujoco_fullinertia, to_pinocchio
from dynident.results.report.sections.verdict import GRADES
from test_documentation import PAGES, ROOT, rows_after


def test_the_families_are_where_the_page_says() -> None:
    """adding-a-part.md names folder and base class of every family."""
    rows = rows_after("adding-a-part.md", "families")
    stated = {row[0].strip("`"): (row[1].strip("`"), row[2].strip("`")) for row in rows}
    assert stated == {
        name: (family.package.removeprefix("dynident.").replace(".", "/"), family.kind.__name__)
        for name, family in FAMILIES.items()
    }


def test_orders_of_the_ten() -> None:
    """The stated orders are those of the conversions, and Pinocchio's is the one that Pinocchio has."""
    text = (ROOT / "docs/conventions.md").read_text(encoding="utf-8")
    stated = dict(re.findall(r"^\| ([\w]+)[^|]*\| `([^`]*)` \|", text, re.MULTILINE))
    symbols = np.array(TEN)
    assert stated["dynident"].split() == list(TEN)
    assert stated["Pinocchio"].split() == to_pinocchio(symbols).tolist()
    assert stated["MuJoCo"].split() == to_mujoco_fullinertia(symbols).tolist()
    link = Inertia.from_centre_of_mass(4.0, [0.1, 0.02, 0.3], [[5, 0.3, 0.2], [0.3, 6, 0.1], [0.2, 0.1, 2]])
    pinocchio = pytest.importorskip("pinocchio")
    theirs = pinocchio.Inertia(link.mass, link.centre_of_mass, link.about_centre)
    np.testing.assert_allclose(to_pinocchio(link.vector), theirs.toDynamicParameters(), rtol=1e-12)


def test_figures_of_real_robots_in_the_readme_are_those_of_their_page() -> None:
    """No figure stands in the README that the page with the commands does not have."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    table = readme.partition("<!-- real-data table: begin")[2].partition("<!-- real-data table: end -->")[0]
    page = (ROOT / "docs/real-data.md").read_text(encoding="utf-8")
    assert set(re.findall(r"[\d.]+ %", table)) <= set(re.findall(r"[\d.]+ %", page))


def test_figures_beside_peers_in_the_readme_are_those_of_their_pages() -> None:
    """Times that were run are in the table of speed; errors are in the page of real logs."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    table = readme.partition("<!-- peers -->")[2].partition("On real arms")[0]
    times = set(re.findall(r"[\d.]+ (?:ns|us|ms)", table))
    assert len(times) >= 4
    speed = (ROOT / "docs/performance.md").read_text(encoding="utf-8")
    assert not [time for time in times if time not in speed]
    errors = re.search(r"real TX40.*?\| ([\d.]+), run \| ([\d.]+), ", table)
    page = (ROOT / "docs/real-data.md").read_text(encoding="utf-8")
    assert errors and f" {errors[1]} " in page and f"{errors[2]} " in page
    kinds = [file for file in (ROOT / "src/dynident/diagnosis/checks").glob("[a-z]*.py") if file.stem != "base"]
    assert f"{len(kinds)} kinds of check" in table


def test_grades_are_those_of_the_report() -> None:
    """The page says what each grade of the report means, and figures of real arms that their page has."""
    page = (ROOT / "docs/how-good-is-good.md").read_text(encoding="utf-8")
    stated = re.findall(r"^\| up to (\d+) % \| ([a-z ]+) \|", page, re.MULTILINE)
    assert [(int(limit) / 100, word) for limit, word in stated] == list(GRADES)
    arms = page.partition("<!-- real arms -->")[2].partition("Each by")[0]
    known = (ROOT / "docs/real-data.md").read_text(encoding="utf-8")
    assert set(re.findall(r"[\d.]+ %", arms)) <= set(re.findall(r"[\d.]+ %", known))


def test_options_of_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    """Every option that the page of the case file names is one of ``identify``."""
    text = (ROOT / "docs/case-file.md").read_text(encoding="utf-8").partition("## What the command line changes")[2]
    with pytest.raises(SystemExit):
        main(["identify", "--help-all"])
    known = re.findall(r"--[a-z]+", capsys.readouterr().out)
    assert set(re.findall(r"--[a-z]+", text.partition("\n## ")[0])) <= set(known)


def test_environment_variables() -> None:
    """The page of the installation lists the variables that the package reads, and no other."""
    sources = "".join(file.read_text(encoding="utf-8") for file in (ROOT / "src").rglob("*.py"))
    text = (ROOT / "docs/packaging.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `(DYNIDENT_\w+)`", text, re.MULTILINE)) == set(re.findall(r"DYNIDENT_[A-Z]+", sources))


def _anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as they are made from the text."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CHANGELOG.md", ROOT / "SECURITY.md"], ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    """A relative link names a file that is there, and a heading in it."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if target.startswith("https://"):
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        assert file.exists(), f"{page.name}: {target}"
        assert not anchor or anchor in _anchors(file), f"{page.name}: {target}"


def test_licence_citation_and_changelog_agree_with_the_project() -> None:
    """The licence is the text of Apache-2.0; version and licence are stated once and the same."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert (citation["version"], citation["license"]) == (project["version"], project["license"])
    assert citation["authors"][0]["name"] == project["authors"][0]["name"]
    licence = (ROOT / "LICENSE").read_bytes()
    assert hashlib.sha256(licence).hexdigest() == "cfc7749b96f63bd31c3c42b5c471bf756814053e847c10f3eb003417bc523d30"
    assert "## [Unreleased]" in (ROOT / "CHANGELOG.md").read_text()
