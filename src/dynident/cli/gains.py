"""Find the drive gains of a robot, joint torque per ampere, from logs of motor currents.

With --load: two runs, without and with a payload of known mass fixed to the arm. Centre and inertia of the payload may
be stated; what is not stated is found along with the gains. Without --load: one run against the links of the robot
model (or --prior), trusted within --prior-share. The case file says which columns are currents, the friction and
the filter; it needs no gains. Friction of each run is found anew, so the runs may be days apart.

The lines for the case file are printed; -o writes a copy of the case with them. Its deviations are then stated by
'dynident identify'. The exit code is 1 where the logs do not determine a gain: the table says why and what to do.

  dynident gains case.yaml free.csv --load loaded.csv --mass 2.6 --com 0,0,0.05
  dynident gains case.yaml free.csv --load loaded.csv --mass 2.6 -o with-gains.yaml
  dynident gains case.yaml run.csv --prior-share 0.1 --json
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from dynident.cli import console, jobs
from dynident.errors import BadOption
from dynident.files import bytes_of, check_outputs, check_place, write_atomically

if TYPE_CHECKING:
    from dynident.applications.drive_gains import CarriedBody, DriveGains
    from dynident.case.case import Case
    from dynident.case.drives_text import GainLine
    from dynident.cli.console import Progress
    from dynident.results.text import Table

SUMMARY = "drive gains from motor currents"

#: Options in the short help.
FREQUENT = ("--load", "--mass", "--com", "--prior-share", "-o", "--json")


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("case", metavar="CASE|ROBOT", help="case file or robot model")
    parser.add_argument("logs", nargs="*", metavar="LOG", help="logs without the payload; default: train of the case")
    load = parser.add_argument_group("a known payload")
    load.add_argument("--load", nargs="+", default=[], metavar="LOG", help="logs with the payload")
    load.add_argument("--mass", type=float, metavar="KG", help="its mass")
    load.add_argument("--mass-std", type=float, default=0.0, metavar="KG", help="standard deviation of its mass")
    load.add_argument("--com", metavar="X,Y,Z", help="its centre of mass in its frame, in m; default: to be found")
    load.add_argument("--inertia", metavar="XX,XY,XZ,YY,YZ,ZZ", help="about its centre, kg m^2; default: to be found")
    load.add_argument("--frame", default="", metavar="NAME", help="link or frame it is fixed to; default: the tool")
    prior = parser.add_argument_group("known bodies (without --load)")
    prior.add_argument("--prior", metavar="FILE", help="description or estimate with the inertias; default: the case's")
    prior.add_argument(
        "--prior-share", type=float, metavar="SHARE", help="relative std of the links and their parameters; 0: exact"
    )
    how = parser.add_argument_group("method")
    how.add_argument("--method", default="structured", metavar="NAME", help="structured (default), tls, wls or ols")
    how.add_argument("--signed", action="store_true", help="a gain for each sign of the current, to compare the two")
    how.add_argument("--friction", nargs="+", metavar="NAME", help="friction parts in place of the case's")
    how.add_argument("--cutoff", type=float, metavar="HZ", help="cut-off of a Butterworth filter on both sides")
    how.add_argument("--delay", metavar="S", help="seconds by which currents lag, or 'auto'")
    output = parser.add_argument_group("output")
    output.add_argument("-o", "--output", metavar="FILE", help="write the case with the gains here")
    output.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    output.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.case.drives_text import case_with_drives, drives_section, stated_drives

    payload = _payload(options)
    options.split, options.test, options.rate = None, [], None  # not asked for here
    case = jobs.case_from(options, open_gains=True)
    case, left_out = _with_sure_friction(case)
    names = tuple(options.logs) or case.train
    if not names:
        raise BadOption("LOG", "", "name a log on the command line, or under train: in the case file")
    data = bytes_of(case.path) if case.path else b""  # none for a case made from a robot alone
    if options.output:
        if not case.path:
            raise BadOption("--output", options.output, "it is a copy of the case; write one with 'dynident init'")
        check_place(options.output)
        inputs = (options.case, *case.files, *(case.find(name) for name in (*names, *options.load)))
        check_outputs((options.output,), inputs)
    with console.progress(8, options.quiet or options.json) as progress:
        found = _found(case, names, options, payload, progress)
    if left_out:
        told = (
            f"friction parts that held-out samples choose are left out ({', '.join(left_out)}); --friction names parts"
        )
        found = replace(found, remarks=(*found.remarks, told))
    lines = _lines(found)
    section = drives_section(case.robot, lines, stated_drives(case.path, data) if data else {})
    if options.output:
        write_atomically(options.output, case_with_drives(case.path, data, case.robot, lines))
    if options.json:
        console.answer_json({**found.figures(), "drives": section, "written": options.output or None})
        return 0 if found.complete else 1
    _show(found, section, options.output)
    if options.output:
        open_ = [gain.joint for gain in found.gains if not gain.known]
        follow = f"it asks for the gains of {', '.join(open_)}; then" if open_ else "next"
        console.remark(f"saved {options.output}; {follow}: dynident identify {options.output}", options.quiet)
    return 0 if found.complete else 1


def _payload(options: argparse.Namespace) -> CarriedBody | None:
    """Return the payload of the command line; None where no log with one is given."""
    import numpy as np

    from dynident.applications.drive_gains import CarriedBody

    stated = [name for name in ("mass", "com", "inertia") if getattr(options, name) is not None]
    if not options.load:
        if stated or options.frame or options.mass_std:
            raise BadOption("--load", "", "a payload is stated: name the logs with it (--load LOG)")
        return None
    if options.mass is None:
        raise BadOption("--mass", "", "weigh the payload: its mass sets the scale of all gains (--mass KG)")
    for name in ("prior", "prior_share"):
        if getattr(options, name) is not None:
            raise BadOption(f"--{name.replace('_', '-')}", getattr(options, name), "it does not go with --load")
    centre = _numbers("--com", options.com, 3)
    six = _numbers("--inertia", options.inertia, 6)
    body = None
    if six is not None:
        xx, xy, xz, yy, yz, zz = six
        body = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return CarriedBody(
        options.mass, None if centre is None else np.array(centre), body, options.frame, options.mass_std
    )


def _numbers(option: str, text: str | None, count: int) -> list[float] | None:
    if text is None:
        return None
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if len(found) != count:
        raise BadOption(option, text, f"give {count} numbers with commas between them")
    return found


def _found(
    case: Case, names: Sequence[str], options: argparse.Namespace, payload: CarriedBody | None, progress: Progress
) -> DriveGains:
    """Return the drive gains of the logs that are named."""
    from dynident.api.case_options import prior_of
    from dynident.applications.drive_gains import GainOptions, gains_from_payload, gains_from_prior

    progress.step("reading")
    without = [case.read_currents(name) for name in names]
    if case.split is not None and not options.logs:  # what the case tests on stays unseen
        without = [case.split.apply(log)[0] for log in without]
    how = GainOptions(options.method, options.signed, current=_current_unit(case))
    if payload is not None:
        loaded = [case.read_currents(name) for name in options.load]
        return gains_from_payload(case.model, without, loaded, payload, case.preprocessing, how, progress.step)
    if options.prior_share is None:
        step = (
            "say how far the bodies are trusted, such as 0.1 for 10 % a link; or give two runs with --load and --mass"
        )
        raise BadOption("--prior-share", "", step)
    known = prior_of(case)
    theta = None if known is None else known.for_model(case.model).theta
    return gains_from_prior(case.model, without, theta, options.prior_share, case.preprocessing, how, progress.step)


def _with_sure_friction(case: Case) -> tuple[Case, list[str]]:
    """Return a case without the parts that identify would choose, and their names; rotors stay, which currents turn."""
    from dynident.model.friction import FRICTION

    rotors = [part for part in case.friction if all(part.is_inertia)]
    kept = [part for part in case.friction if not part.is_optional and part not in rotors]
    if case.choose_friction and not rotors and not any(joint.drive.rotor_inertia for joint in case.robot.active):
        rotors = [FRICTION.make("rotor_inertia")]
    left_out = [FRICTION.name_of(part) for part in case.friction if part.is_optional and part not in rotors]
    return replace(case, friction=(*kept, *(replace(part, choose=None) for part in rotors))), left_out


def _current_unit(case: Case) -> str:
    """Return the unit of the currents that a case reads, of which its gains are; A where drives differ."""
    from dynident.data.formats._units import RATED, counted_unit

    words = {counted_unit(word)[1] for word in case.columns.units.of("current", len(case.columns.joints))}
    return words.pop() if len(words) == 1 and words <= RATED else "A"


def _lines(found: DriveGains) -> dict[str, GainLine]:
    """Return the gains as they go into a case; one for each sign goes into none."""
    from dynident.case.drives_text import GainLine

    lines = {}
    for gain in found.gains:
        if gain.sign:
            continue
        told = "these logs do not determine it"
        if abs(gain.low) < float("inf") > abs(gain.high):
            told = f"{gain.low:.3g} to {gain.high:.3g} by these logs"
        known = GainLine(gain.value, gain.deviation, "")
        lines[gain.joint] = known if gain.known else GainLine(None, 0.0, told)
    return lines


def _show(found: DriveGains, section: str, output: str | None) -> None:
    from dynident.results.text import format_number, in_words, label

    console.answer(f"drive gains by the method '{found.method}'; the scale is set by {found.scale}")
    console.answer(f"filter {in_words(found.filter)}\n")
    console.answer_table(_table(found))
    unit = found.gains[0].unit.partition("/")[2]
    ends = f"from, to: {100 * found.level:g} % interval"
    console.answer(f"{ends}; i: current in {unit} rms, asked of it by what sets the scale, left by the fit")
    if found.found:
        values = ", ".join(f"{name} {format_number(value, 3)}" for name, value in found.found.items())
        console.answer(f"\nfound of the payload, in its frame: {values}")
    if found.delays:
        console.answer(f"delays of the currents: {', '.join(f'{1e3 * delay:.3g}' for delay in found.delays)} ms")
    console.answer()
    for reason in dict.fromkeys(gain.reason for gain in found.gains if gain.reason):
        alike = [gain for gain in found.gains if gain.reason == reason]
        console.answer(f"{', '.join(label(gain.name) for gain in alike)}: {alike[0].label}: {reason}")
    for remark in found.remarks:
        console.answer(f"remark: {remark}")
    if any(gain.sign for gain in found.gains):
        console.answer("gains for each sign go into no case file; without --signed one for both is found")
    elif not output:
        console.answer("for the case file:\n")
        console.answer_verbatim(section.rstrip())


def _table(found: DriveGains) -> Table:
    from dynident.results.text import (
        MISSING,
        Table,
        columns_of,
        format_number,
        format_percent,
        format_value,
        label,
        pretty_unit,
    )

    rows = []
    for gain in found.gains:
        shown, _ = format_value(gain.value, abs(gain.value) * gain.deviation)
        ends = [format_number(end, 4) if abs(end) < float("inf") else MISSING for end in (gain.low, gain.high)]
        has_ends = MISSING not in ends
        rows.append(
            (
                label(gain.name),
                shown if has_ends else MISSING,
                *(ends if has_ends else [MISSING, MISSING]),
                pretty_unit(gain.unit),
                format_percent(gain.deviation, sign=False) if abs(gain.deviation) < float("inf") else MISSING,
                *(format_number(value, 2) for value in (gain.current, gain.driven, gain.residual)),
                gain.label,
            )
        )
    columns = columns_of("joint", ">gain", ">from", ">to", "unit", ">std [%]", ">i", ">asked", ">left", "verdict")
    return Table(columns, tuple(rows))
