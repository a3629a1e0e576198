"""How well a simulator's damping and Coulomb friction stand for the friction of an estimate: real logs, held-out rows.

Each case is identified as it ships (consistent fit) and tested on the samples in motion, all torques filtered alike:
the estimate, the model that exports to MuJoCo hold (bodies, armature, and damping and Coulomb friction nearest to all
parts), and the same with the Coulomb and the viscous part alone. What no simulator holds, such as offsets, is missing
in both.
Needs the logs under the folder that DYNIDENT_DATA names.
Run: python -m benchmarks.exported_friction [CASE...]
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from benchmarks.real_data import CASES, RUNS, data_of, how_of
from dynident import read_case
from dynident.data.preprocessing import preprocess
from dynident.exports.models.subject.drives import drives_of, rigid_torque
from dynident.exports.models.subject.identified import identified
from dynident.identification.identify import identify
from dynident.identification.problem.regressor_stream import motion_of


def two_parts(subject, drives):
    """Return the drives with the Coulomb and the viscous part alone."""
    model, held = subject.model, {"damping": np.zeros(len(drives.joints)), "friction": np.zeros(len(drives.joints))}
    table, column = model.coefficient_table(subject.theta), 0
    for part in model.friction:
        own = table[:, column : column + len(part.coefficients)]
        column += len(part.coefficients)
        for j in model.drives_of(part):
            for word, value in part.in_simulators(own[j])[0].items():
                if word in held:
                    held[word][j] += value
    return replace(drives, damping=held["damping"], dry=held["friction"])


def errors(case, change):
    """Return the relative errors of the estimate, of what is exported and of two parts alone, samples in motion."""
    train, test = data_of(case, change)
    how = how_of(case, change)
    estimate = identify(case.model, train, "consistent", how)
    subject = identified(estimate)
    drives = drives_of(subject)
    sums = np.zeros(4)
    for log in test:
        prepared = preprocess(log, estimate.preprocessing)
        motion = motion_of(prepared.log)
        whole = estimate.model.with_states(motion, 1.0 / prepared.log.rate)
        found = [estimate.model.torque(whole, subject.theta)]
        for own in (drives, two_parts(subject, drives)):
            found.append(rigid_torque(subject, motion) + own.torque(motion, armature=True, coupled=True))
        moves = np.abs(prepared.kept.dq) > max(how.standstill, 0.02)
        torque = prepared.kept.torque
        left = [(torque - prepared.smooth(one.T).T[prepared.keep]) * moves for one in found]
        sums += [np.sum((torque * moves) ** 2), *(np.sum(one**2) for one in left)]
    return np.sqrt(sums[1:] / sums[0])


def main() -> None:
    wanted = sys.argv[1:]
    if unknown := set(wanted) - (known := {name for name, _, _ in RUNS}):
        sys.exit(f"no case {', '.join(sorted(unknown))}: give one of {', '.join(sorted(known))}")
    print("| case | run | estimate | exported | Coulomb and viscous alone |\n|---|---|---|---|---|")
    for name, told, change in RUNS:
        if (wanted and name not in wanted) or told == "all data":
            continue
        case = read_case(CASES / f"{name}.yaml")
        if "friction" in change:
            continue
        cells = " | ".join(f"{100 * value:.3g} %" for value in errors(case, change))
        print(f"| {name} | {told} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
