"""Identify the dynamic model of a robot from logs.

CASE is a case file (see 'dynident init') or a robot model: URDF, MJCF, SDF, DH table in YAML or built-in example robot.
Without a case file the model has Coulomb and viscous friction and an offset; columns are t, q1.., tau1.. (or i1.. with
drive gains) in chain order, in SI units; the filter is a zero-phase Butterworth on both sides, its cut-off chosen.

  dynident identify robot.urdf run.csv --split first:0.67
  dynident identify case.yaml -o estimate.json --report report.html
  dynident identify case.yaml a.csv b.csv --test c.csv --estimator wls --json
  dynident identify case.yaml --from all.tri

The answer takes one screen: verdict, errors by joint, links, data, warnings; --full shows all tables.

The log checks ('dynident check') look at the training logs before the fit. A wrong unit of time or an unreadable
column stops it. After any other finding at error level the estimate is written, not accepted; the exit code is 4.

Exit codes: 0 accepted or no criteria, 1 an error of the input, 2 wrong usage, 3 acceptance criteria not met
(accept: in the case file, or --accept), 4 a finding of the log checks at error level, 130 interrupted.

A case with the key servo has logs of commanded and measured positions without torques: the answer is the actuator of
each joint (torque, armature, friction, delay), and only --test, -o, --json and --quiet apply.

Logs of more than 512 MiB together are reduced as a stream where case and estimator allow it ('dynident reduce').
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from shlex import quote
from typing import TYPE_CHECKING, Any

from dynident.cli import console, jobs, verdicts
from dynident.errors import BadOption
from dynident.files import check_outputs, check_place

if TYPE_CHECKING:
    from dynident.case.case import Case
    from dynident.data.log import Log
    from dynident.identification.estimate.estimate import Estimate
    from dynident.identification.estimate.validation import Validation
    from dynident.identification.estimators import Estimator
    from dynident.identification.streaming.digest import Digest

SUMMARY = "identify a physically consistent dynamic model from logs"

#: Options in the short help.
FREQUENT = (
    "--test",
    "--split",
    "--friction",
    "--estimator",
    "--cutoff",
    "--accept",
    "-o",
    "--report",
    "--full",
    "--json",
)


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("case", metavar="CASE|ROBOT", help="case file or robot model")
    parser.add_argument("logs", nargs="*", metavar="LOG", help="logs to learn from; default: those of the case file")
    parser.add_argument("--test", nargs="+", default=[], metavar="LOG", help="logs to test on, not used in the fit")
    parser.add_argument(
        "--from", dest="triangles", metavar="FILE", help="QR factors of 'dynident reduce' or 'merge' in place of logs"
    )
    method = parser.add_argument_group("estimator")
    estimators = "see 'dynident list estimators', such as huber:bound=2; default: consistent"
    method.add_argument("--estimator", metavar="NAME[:KEY=VALUE...]", help=estimators)
    method.add_argument("--option", action="append", default=[], metavar="KEY=VALUE", help="an option of the estimator")
    known = parser.add_argument_group("prior knowledge (can be set in the case file)")
    known.add_argument("--prior", metavar="FILE", help="robot model or estimate whose inertias are the prior")
    known.add_argument(
        "--bodies",
        choices=("free", "plausible", "auto"),
        help="links of the estimator consistent: any of positive density, or within bounds that follow from the robot "
        "model and near it where the data allow; default: auto, plausible where the model has inertias or shapes",
    )
    known.add_argument("--constraints", metavar="FILE", help="masses, centres, hulls: YAML as in the case file")
    jobs.add_case_options(parser)
    trust = parser.add_argument_group("diagnostics")
    trust.add_argument("--no-check", action="store_true", help="skip the log checks; the verdict says so")
    jobs.add_accept(trust)
    trust.add_argument(
        "--cross-validate", type=int, metavar="N", help="folds of the cross-validation, 2 to 100; 0: none; default: 5"
    )
    trust.add_argument("--bootstrap", type=int, default=0, metavar="N", help="bootstrap intervals by N fits")
    trust.add_argument(
        "--ranges", action="store_true", help="range of each standard parameter that data and bounds of the links allow"
    )
    trust.add_argument("--no-sensitivity", action="store_true", help="skip the fits at half and double the cut-off")
    output = parser.add_argument_group("output")
    output.add_argument("-o", "--output", metavar="FILE", help="write the estimate (JSON) here")
    output.add_argument("--report", metavar="FILE", help="write the report (one HTML file) here")
    output.add_argument("--full", action="store_true", help="show all tables: parameters, metrics, links, diagnostics")
    output.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    output.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dataclasses import replace

    from dynident.api.estimate_output import summary, write_estimate
    from dynident.api.validate import compared
    from dynident.case.acceptance import with_accept
    from dynident.diagnosis.verdict import verdict_of

    for place in filter(None, (options.output, options.report)):
        check_place(place)
    with console.progress(9, options.quiet or options.json) as progress:
        progress.step("reading")
        if options.triangles:
            from dynident.identification.streaming.triangle_file import read_digest

            jobs.take_model_options(options, read_digest(options.triangles).options)
        case = jobs.case_from(options)
        if case.servo is not None:
            from dynident.cli import actuators

            return actuators.run(case, options)
        case = replace(case, accept=with_accept(case.accept, options.accept))
        inputs = (options.case, options.constraints or "", options.triangles or "", *case.files)
        case = jobs.with_logs(case, options)
        check_outputs((options.output, options.report), (*inputs, *case.files))
        estimate, tests = _estimate(case, options, progress.step)
        progress.step("validating")
        test = compared(estimate, tests) if tests else None
        if options.report:
            from dynident.results.report import write_report

            progress.step("writing the report")
            found, sources = () if test is None else (test,), [log.source for log in tests]
            write_report(options.report, estimate, found, command=jobs.repeat_command(), sources=sources)
    if options.output:
        write_estimate(estimate, options.output, test)
    verdict = verdict_of(estimate, test)
    if options.json:
        console.answer_json(summary(estimate, test, verdict))
        return verdict.code
    if options.full:
        verdicts.show(verdict)
        _show(estimate, test)
    else:
        verdicts.show_short(estimate, test, verdict)
    if options.output:
        step = f"next: dynident validate {quote(options.output)} other-run.csv"
        if test is not None or verdict.causes:
            step = verdicts.next_step(options.output, estimate, verdict)
        console.remark(f"saved {options.output}; {step}", options.quiet)
    return verdict.code


def _estimate(
    case: Case, options: argparse.Namespace, progress: Callable[[str], None]
) -> tuple[Estimate, tuple[Log, ...]]:
    """Return the estimate, from logs in memory or from triangles, and the logs to test it on."""
    from dataclasses import replace

    from dynident.api.case_logs import read_data, test_logs
    from dynident.api.case_options import estimator_of, with_drive_friction
    from dynident.api.identify import DEFAULT_TRUST, Record, identify
    from dynident.identification.estimators import ESTIMATORS

    estimator = estimator_of(case, options.estimator, [*options.option, *["ranges=true"] * options.ranges])
    if options.bodies and not ESTIMATORS.has_option(ESTIMATORS.name_of(estimator), "bodies"):
        those = " and ".join(name for name in ESTIMATORS.names() if ESTIMATORS.has_option(name, "bodies"))
        raise BadOption("--bodies", options.bodies, f"it is for the estimator {those}; leave one of the two out")
    record = Record(command=jobs.repeat_command(), checks=not options.no_check)
    digest, quality = _digest(case, options, estimator, progress)
    if digest is not None:
        record = replace(record, quality=quality)
        return identify(case, digest, estimator, record=record, progress=progress), test_logs(case, digest)
    case = case if options.friction else with_drive_friction(case)
    data = read_data(case)
    folds = DEFAULT_TRUST.folds if options.cross_validate is None else options.cross_validate
    estimate = identify(
        case,
        data.train,
        estimator,
        trust=replace(DEFAULT_TRUST, folds=folds, bootstrap=options.bootstrap, sensitivity=not options.no_sensitivity),
        record=record,
        progress=progress,
    )
    return estimate, data.test


def _digest(
    case: Case, options: argparse.Namespace, estimator: Estimator, progress: Callable[[str], None]
) -> tuple[Digest | None, list[dict[str, Any]] | None]:
    """Return the triangles to identify from, None where the logs are read into memory, and what the checks found.

    Raises:
        DynidentError: Triangles of another model, options that need rows, or any fault of a log.
    """
    from dynident.api.case_logs import digest_of_file, is_streamed, reduced_logs
    from dynident.api.log_checks import check_heads, refuse_faulty

    if not options.triangles:
        asked = "--bootstrap" * bool(options.bootstrap) or "--cross-validate" * bool(options.cross_validate)
        if not is_streamed(case, estimator, asked, progress):
            return None, None
        quality = None if options.no_check else check_heads(case, progress)
        refuse_faulty(quality or ())
        return reduced_logs(case, progress), quality
    for given, name in (
        (options.logs, "LOG"),
        (options.bootstrap, "--bootstrap"),
        (options.cross_validate, "--cross-validate"),
    ):
        if given:
            raise BadOption(name, given, "it needs the samples of logs, and --from gives QR factors; leave one out")
    return digest_of_file(case, options.triangles, estimator), None


def _show(estimate: Estimate, test: Validation | None) -> None:
    from dynident.diagnosis.warnings import warnings_of
    from dynident.results.choices import choice_tables, cutoff_lines
    from dynident.results.plausibility import plausibility_lines
    from dynident.results.short_answer import labels_line
    from dynident.results.text import fits_table, format_number, in_words, parameters_table, total_error

    model = estimate.model
    console.answer(
        f"{model.robot.name}: {model.robot.dof} joints, {estimate.base.count} base parameters "
        f"({estimate.inertial_base_parameters} inertial), {estimate.samples} samples, "
        f"condition number {format_number(estimate.condition_number, 3)} (weighted, unit columns)"
    )
    console.answer(f"estimator {estimate.estimator}; filter {in_words(estimate.train.filter)}\n")
    console.answer_table(parameters_table(estimate, width=console.NAME_WIDTH))
    for title, validation in (("training data", estimate.train), ("test data", test)):
        if validation is not None:
            console.answer()
            console.answer_table(fits_table(validation), f"{title}: total relative error {total_error(validation)}")
            verdicts.show_rest(validation)
    verdicts.show_nominal(estimate, test)
    for title, table in choice_tables(estimate.choices, model):
        console.answer()
        console.answer_table(table, title)
    console.answer()
    console.answer(consistency_line(estimate))
    if labels_line(estimate):
        console.answer(labels_line(estimate))
    for line in plausibility_lines(estimate, test):
        console.answer(line)
    verdicts.show_ranges(estimate)
    for line in cutoff_lines(estimate.choices):
        console.answer(line)
    if estimate.diagnostics is not None:
        console.answer("\ndiagnostics")
        for sentence in estimate.diagnostics["verdicts"]:
            console.answer(f"  {sentence}")
    for warning in warnings_of(estimate, test):
        console.answer(f"warning: {warning}")


def consistency_line(estimate: Estimate) -> str:
    """Return in one line whether the estimate is physically consistent."""
    from dynident.identification.consistency.verdicts import describe_reasons

    verdict = estimate.consistency
    if verdict.consistent:
        return f"physically consistent: yes (smallest eigenvalue of M(q) {verdict.smallest_inertia:.3g})"
    return f"physically consistent: NO: {describe_reasons(verdict.reasons)}"
