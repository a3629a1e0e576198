"""Check logs before a fit: errors, evidence and remedies.

Time, values, units, signs, orders, delays, saturation, excitation and more; docs/log-checks.md lists them.
Nothing is changed. --fix writes a repaired log: it sorts samples by time, drops repeated samples and samples
that are not finite (up to 5 %), and removes encoder jumps. The exit code is 1 where there is a finding at error level.

  dynident check case.yaml run.csv
  dynident check robot.urdf run.csv --fix repaired.csv
  dynident check case.yaml monday.csv --against estimate.json
  dynident check case.yaml --json
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence, Set
from typing import TYPE_CHECKING, Any

from dynident.cli import console
from dynident.errors import BadOption, LogMismatch
from dynident.files import check_outputs, check_place

if TYPE_CHECKING:
    from dynident.case.case import Case
    from dynident.diagnosis.examination import Examination
    from dynident.diagnosis.finding import Finding
    from dynident.identification.estimate.estimate import Estimate

SUMMARY = "log checks before a fit: errors, evidence and remedies"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("case", metavar="CASE|ROBOT", help="case file or robot model")
    parser.add_argument("logs", nargs="*", metavar="LOG", help="logs to look at; default: those of the case file")
    parser.add_argument(
        "--against",
        metavar="ESTIMATE",
        help="earlier estimate of the robot: tells what has changed since; default: the case's prior if it is one",
    )
    parser.add_argument("--fix", metavar="OUT", help="write the repaired log here, one log only; the case reads it")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of lines")
    parser.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.case.case import read_case
    from dynident.diagnosis.examination import examine_logs

    case = read_case(options.case, open_gains=True)
    if case.servo is not None:
        from dynident.cli import actuators

        return actuators.check(case, options)
    names = tuple(dict.fromkeys(options.logs or (*case.train, *case.test)))
    if not names:
        raise BadOption("LOG", "", "name a log on the command line, or under train: in the case file")
    if options.fix:
        if len(names) != 1:
            raise BadOption("--fix", options.fix, "name one log on the command line: one log is written")
        _check_fix(options.fix)
        check_place(options.fix)
        check_outputs((options.fix,), (options.case, *case.files, *(case.find(name) for name in names)))
    earlier = _earlier(case, options.against)
    with console.progress(len(names), options.quiet or options.json) as progress:
        found = examine_logs(case, names, earlier, progress.step)
    together = len(found) > len(names) and bool(found[-1].findings)
    for examination in () if options.json else found:
        show(examination, "nothing of its own" if together else "nothing found")
    mends = _fixed(found[0], options.fix) if options.fix else None
    if options.json:
        console.answer_json(_figures(case, found, mends))
    for mend in () if options.json else mends or ():
        console.answer(f"{options.fix}: {mend}")
    return 0 if all(examination.sound for examination in found) else 1


def _earlier(case: Case, name: str | None) -> Estimate | None:
    """Return the estimate that logs are held against, of the joints of the case; None where there is none."""
    if name is None and not case.prior.endswith(".json"):
        return None
    from dynident.api.validate import check_same_lock  # few need it
    from dynident.identification.files.estimate_file import read_estimate

    path = name or str(case.find(case.prior))
    found = read_estimate(path)
    ours, theirs = case.robot.joint_names, found.model.robot.joint_names
    if ours != theirs:
        evidence = f"an estimate of {', '.join(theirs)}, where the case has {', '.join(ours)}"
        raise LogMismatch(path, evidence, "give an estimate of this robot, with the same joints locked")
    check_same_lock(found.model.robot, case.robot, case.path)
    return found


def _check_fix(out: str) -> None:
    """Refuse a name whose suffix states no format that logs are written in."""
    from dynident.data.formats import FORMATS
    from dynident.data.formats.base import LogFormat

    written = [kind for kind in map(FORMATS.get, FORMATS.names()) if kind.write is not LogFormat.write]
    suffixes = [suffix for kind in written for suffix in kind.suffixes]
    if not out.lower().endswith(tuple(suffixes)):
        raise BadOption("--fix", out, f"end the name in the suffix of its format: {', '.join(suffixes)}")


def _fixed(examination: Examination, out: str) -> tuple[str, ...]:
    """Write the repaired log, and return the repairs and how it is read."""
    from dynident.diagnosis.repaired_file import write_repaired

    if examination.repaired is None:
        raise LogMismatch(examination.path, "it cannot be read", examination.findings[0].remedy)
    how = write_repaired(examination.repaired, out)
    return (*(examination.repaired.repairs or ("nothing to repair",)), how)


def _figures(case: Case, found: Sequence[Examination], mends: tuple[str, ...] | None) -> dict[str, Any]:
    return {
        "robot": case.robot.name,
        "sound": all(examination.sound for examination in found),
        "logs": [examination.figures() for examination in found],
        "fixes": None if mends is None else list(mends),
    }


def show(examination: Examination, nothing: str = "nothing found") -> None:
    """Print what was found, rivals of a likelier cause under it; notes of one kind about several joints as one."""
    labels = {finding.label for finding in examination.findings if not finding.beside}
    alone = [finding for finding in examination.findings if finding.beside not in labels]
    groups = _alike(alone, {finding.beside for finding in examination.findings})
    counts = {word: sum(finding.severity == word for finding, *_ in groups) for word in ("error", "warning", "note")}
    told = ", ".join(f"{count} {word}{'s' if count != 1 else ''}" for word, count in counts.items() if count)
    calm = "no error or warning, " if {finding.severity for finding in alone} == {"note"} else ""
    console.answer(f"{examination.path}: {calm}{told or nothing}")
    for finding, *alike in groups:
        joints = dict.fromkeys(", ".join(each.joint for each in (finding, *alike)).split(", "))
        label = f"{finding.name} ({', '.join(joints)}), at {finding.joint}" if alike else finding.label
        console.answer(f"  {finding.severity}: {label}: {finding.evidence}")
        console.answer(f"    {finding.remedy}")
        for rival in examination.findings:
            if rival.beside == finding.label and rival not in alone:
                console.answer(f"    or {rival.label}: {rival.evidence.split(f'{rival.beside}: ')[-1]}")
    if examination.left_out:
        console.answer(f"  {examination.left_out}")


def _alike(findings: Sequence[Finding], rivalled: Set[str]) -> list[list[Finding]]:
    """Return findings, notes of one name and one remedy together where nothing else stands beside them."""
    groups: dict[tuple[str, str], list[Finding]] = {}
    for finding in findings:
        is_own = finding.severity != "note" or not finding.joint or finding.label in rivalled
        groups.setdefault((finding.label if is_own else finding.name, finding.remedy), []).append(finding)
    return list(groups.values())
