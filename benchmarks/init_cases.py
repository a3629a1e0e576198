"""Case files that ``dynident init`` drafts for real logs, beside those written by hand.

``init`` drafts a case of each set from its robot model and logs; only what the draft asks for is filled in, from the
table of answers below; the case and the hand-written one then learn from and are tested on the same rows. The error is
the held-out total relative error, of both under the filter of the hand-written case, and of the draft under its own.
Beside it stand the parameters of the draft, the share of them that is not significant (an interval that holds zero, or
no value), and the seconds of the processor that its identification takes.

Needs the logs under the folder that DYNIDENT_DATA names.
Run: python -m benchmarks.init_cases [CASE...]
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from dynident import identify, read_case
from dynident.api.validate import compared
from dynident.case.case import Case
from dynident.case.questions import ASK, MARK, questions_in
from dynident.cli.main import main as dynident
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation
from dynident.results.short_answer import not_significant

CASES = Path(__file__).resolve().parent.parent / "examples" / "cases"

#: Largest error of a draft over that of the hand-written case.
BOUND = 1.05

_UR = "ur10e_mamedov/ident_20_"
_LWR = "kuka_lwr4_flobaroid/measurements_"
_TIAGO = ("torso_lift_joint", *(f"arm_{k}_joint" for k in range(1, 8)))
_TX40_COUPLING = (
    "[[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0], "
    "[0, 0, 0, 0, 1, 1]]"
)


@dataclass(frozen=True)
class Set:
    """A set of logs: the arguments of ``init``, and what is known beside the logs.

    Attributes:
        robot: Robot model.
        train: Logs to learn from.
        test: Logs to test on; empty where the rows of one log are split as the hand-written case says.
        answers: Answer by words of the question.
    """

    robot: str
    train: tuple[str, ...]
    test: tuple[str, ...] = ()
    answers: Mapping[str, str] = field(default_factory=dict)


SETS: Mapping[str, Set] = {
    "panda": Set("panda_gaz2019/robot.urdf", ("panda_gaz2019/exciting_traj_1.csv",)),
    "lwr4": Set("kuka_lwr4_flobaroid/robot.urdf", (f"{_LWR}2.csv", f"{_LWR}3.csv"), (f"{_LWR}1.csv",)),
    "tx40": Set(
        "staubli_tx40_figaroh/robot.urdf",
        ("staubli_tx40_figaroh/trajectory.csv",),
        answers={"a motor turn more than its own joint": _TX40_COUPLING},
    ),
    "tiago": Set(
        "tiago_figaroh/robot_full.urdf",
        ("tiago_figaroh/trajectory.csv",),
        answers={
            "the joints of the 8 columns": f"[{', '.join(_TIAGO)}]",
            "the bias of torso_lift_joint": "185.468",
            **{
                f"the drive gain of {joint},": gain
                for joint, gain in zip(
                    _TIAGO, ("1", "13.6", "13.6", "-8.7", "-8.7", "-20.5968", "-20.5968", "-20.5968"), strict=True
                )
            },
        },
    ),
    "ur10e": Set(
        "ur10e_mamedov/robot.urdf",
        (
            f"{_UR}01_31_unload.csv",
            f"{_UR}02_05_20sec_12harm.csv",
            f"{_UR}02_05_20sec_8harm.csv",
            f"{_UR}02_06_20sec_10harm.csv",
            f"{_UR}02_06_20sec_5harm.csv",
            f"{_UR}02_10_20sec_7harm.csv",
            f"{_UR}02_10_30sec_12harm.csv",
        ),
        (f"{_UR}02_12_40sec_12harm.csv", f"{_UR}02_12_50sec_12harm.csv"),
        answers={
            "the drive gain of shoulder_pan_joint,": "14.87",
            "the drive gain of shoulder_lift_joint,": "13.26",
            "the drive gain of elbow_joint,": "11.13",
            "the drive gain of wrist_1_joint,": "10.62",
            "the drive gain of wrist_2_joint,": "11.03",
            "the drive gain of wrist_3_joint,": "11.47",
        },
    ),
}


@dataclass(frozen=True)
class Outcome:
    """What came out.

    Attributes:
        asked: Questions that had to be answered.
        answered: Answers that were given.
        own: Held-out error of the draft under its own filter.
        drafted: Under the filter of the hand-written case.
        by_hand: That of the hand-written case.
        cutoff_hz: Cut-off that the draft proposes.
        parameters: Number of base parameters of the draft.
        unclear: Share of them that is not significant.
        seconds: Of the processor, to identify the draft.
    """

    asked: int
    answered: int
    own: float
    drafted: float
    by_hand: float
    cutoff_hz: float
    parameters: int
    unclear: float
    seconds: float

    @property
    def ratio(self) -> float:
        """Error of the draft over that of the hand-written case."""
        return self.drafted / self.by_hand


def answered(text: str, answers: Mapping[str, str]) -> str:
    """Return a drafted case with the answers in place of its questions.

    Raises:
        ValueError: A question has no answer, or an answer no question.
    """
    lines, left = text.splitlines(), dict(answers)
    for question in questions_in(text):
        words = next((words for words in left if words in question.text), None)
        if words is None:
            if question.needed:
                raise ValueError(f"line {question.line} asks for {question.text}: no answer in the table")
            continue
        before = lines[question.line - 1].partition(MARK)[0].rstrip()
        answer = left.pop(words)
        if question.needed:
            start, _, end = before.rpartition(ASK)
            lines[question.line - 1] = f"{start}{answer}{end}"
        else:
            lines[question.line - 1] = f"{before.lstrip('# ').partition(':')[0]}: {answer}"
    if left:
        raise ValueError(f"nothing asks for {list(left)}")
    return "\n".join(lines) + "\n"


def drafted(name: str, data: Path, folder: Path) -> tuple[str, Case]:
    """Return the draft of a set as it is written, and the case that it is with the answers.

    Args:
        name: Of the set.
        data: Folder with the sets.
        folder: Where the drafted case is written.

    Raises:
        RuntimeError: ``init`` failed.
    """
    of, target = SETS[name], folder / f"{name}.yaml"
    paths = [str(data / path) for path in of.train]
    tests = ["--test", *(str(data / path) for path in of.test)] if of.test else []
    with contextlib.redirect_stdout(io.StringIO()):
        code = dynident(["init", str(data / of.robot), *paths, *tests, "-o", str(target), "--force", "--json"])
    if code:
        raise RuntimeError(f"init failed on {name}")
    text = target.read_text(encoding="utf-8")
    target.write_text(answered(text, of.answers), encoding="utf-8")
    return text, read_case(target)


def outcome_of(name: str, data: Path, folder: Path) -> Outcome:
    """Return how the draft of a set compares with its hand-written case.

    Args:
        name: Of the set and of the hand-written case.
        data: Folder with the sets.
        folder: Where the drafted case is written.

    Raises:
        RuntimeError: ``init`` failed.
    """
    of = SETS[name]
    text, draft = drafted(name, data, folder)
    hand = read_case(CASES / f"{name}.yaml")
    results: list[list[float]] = []
    seconds, estimates = [], []
    for case in (hand, draft):
        train, test = ([case.read(str(data / path)) for path in own] for own in (of.train, of.test))
        if hand.split is not None and not test:
            parts = [hand.split.apply(log) for log in train]
            train, test = [a for a, _ in parts], [b for _, b in parts]
        begin = time.process_time()
        estimate = identify(case.model, train, case.estimator.name, case.preprocessing)
        seconds.append(time.process_time() - begin)
        estimates.append(estimate)
        same = replace(hand.preprocessing, delay_s=estimate.preprocessing.delay_s)
        results.append([against_model(estimate, test, how).total_relative_error for how in (None, same)])
    return Outcome(
        asked=sum(question.needed for question in questions_in(text)),
        answered=len(of.answers),
        own=results[1][0],
        drafted=results[1][1],
        by_hand=results[0][1],
        cutoff_hz=float(str(draft.preprocessing.filter.statement()["cutoff_hz"])),
        parameters=estimates[1].base.count,
        unclear=len(not_significant(estimates[1])) / estimates[1].base.count,
        seconds=seconds[1],
    )


def against_model(estimate: Estimate, logs: Sequence[Log], how: Preprocessing | None = None) -> Validation:
    """Return a validation that counts samples at rest against the model's torque, as peers do."""
    return compared(estimate, logs, how, interval_at_rest=False)


def main() -> None:
    """Print the table of all sets."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"default: {', '.join(SETS)}")
    options = parser.parse_args()
    data = Path(os.environ["DYNIDENT_DATA"])
    print(
        "| set | needed | answers | cut-off by hand | drafted | error by hand | drafted | ratio | own filter "
        "| parameters | not significant | processor |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name in options.cases or SETS:
            found = outcome_of(name, data, Path(folder))
            hand = read_case(CASES / f"{name}.yaml").preprocessing.filter.statement()["cutoff_hz"]
            print(
                f"| {name} | {found.asked} | {found.answered} | {hand:g} Hz | {found.cutoff_hz:g} Hz "
                f"| {found.by_hand:.3%} | {found.drafted:.3%} | {found.ratio:.3f} | {found.own:.3%} "
                f"| {found.parameters} | {found.unclear:.0%} | {found.seconds:.1f} s |",
                flush=True,
            )


if __name__ == "__main__":
    main()
