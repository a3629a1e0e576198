"""Identified parameters beside published ones, as Markdown: the Panda (Gaz et al. 2019) and the TX40 (FIGAROH).

Published base parameters are carried into ours: a combination c of standard parameters has the value a' beta with
K' a = c, which says as well whether our base parameters determine it. Needs the logs under the folder that
DYNIDENT_DATA names.
Run: python -m benchmarks.published_parameters [panda] [tx40]
"""

from __future__ import annotations

import argparse
import csv
import os
import re
from pathlib import Path

import numpy as np

from dynident import identify, read_case
from dynident.identification.consistency.verdicts import broken_conditions
from dynident.model.inertia import Inertia

CASES = Path(__file__).resolve().parent.parent / "examples" / "cases"
DATA = Path(os.environ.get("DYNIDENT_DATA", "."))

#: A combination of standard parameters is ours when what remains of it is below this share.
OURS = 1e-3

_TERM = re.compile(r"([+-]?)\s*(?:(\d+(?:\.\d+)?(?:e-?\d+)?)\*)?([A-Za-z]+)(\d)")

#: Symbols of FIGAROH's drives and ours.
_DRIVES = {"fv": "Fv", "fs": "Fc", "off": "F0", "Ia": "Ia"}


def combination(text: str, names: list[str], links: list[str], joints: list[str]) -> np.ndarray:
    """Return a combination as FIGAROH writes it, such as ``mx2 + 0.225*m3 + fv5``, over standard parameters (p,).

    Motor 6 turns with joints 5 and 6: fvm6, fsm6 and Iam6 are its friction and inertia. FIGAROH's fv6, fs6 and Ia6 are
    those of joint 6 alone, and with fv5, fs5 and Ia5 those of motor 5.
    """
    found = np.zeros(len(names))
    read = 0
    for sign, factor, symbol, digit in _TERM.findall(text):
        value, number = (-1.0 if sign == "-" else 1.0) * float(factor or 1.0), int(digit)
        drive = _DRIVES.get(symbol)
        name = f"{drive}[{joints[number - 1]}]" if drive else f"{symbol}[{links[number - 1]}]"
        found[names.index(name)] += value
        read += 1
    if read != text.count("+") + text.count(" - ") + 1:
        raise ValueError(f"unread terms in '{text}'")
    return found


def in_ours(matrix: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, float]:
    """Return a with K' a = c, shape (b,), and the share of c that K does not have."""
    found = np.linalg.lstsq(matrix.T, wanted, rcond=None)[0]
    return found, float(np.linalg.norm(matrix.T @ found - wanted) / np.linalg.norm(wanted))


def published_fit(leads: list[str]) -> np.ndarray:
    """Return the least-squares coefficients of Table III on this log, in our order, shape (43,)."""
    text = (DATA / "panda_gaz2019" / "reference_tableIII_raw.txt").read_text(encoding="utf-8")
    text = re.sub(r" × 10\u2212(\d+)", r"e-\1", text).replace("\u2212", "-")
    rows = [line.split()[-6:] for line in text.splitlines()[1:] if len(line.split()) > 6][: len(leads)]
    links = range(2, 8)
    order = ["Izz[link1]", *(f"I{axis}[link{i}]" for i in links for axis in ("xx", "xy", "xz", "yz", "zz"))]
    order += [f"m{axis}[link{i}]" for i in links for axis in "xy"]
    values = dict(zip(order, (float(row[3]) for row in rows), strict=True))
    return np.array([values[lead] for lead in leads])


def panda() -> None:
    """Print base parameters of both fits beside K theta of the published parameters, and what is possible by link."""
    case = read_case(CASES / "panda.yaml")
    log = [case.read(file) for file in case.train]
    free, possible = (identify(case.model, log, name, case.preprocessing) for name in ("wls", "consistent"))
    inertial = case.model.inertial_count
    nominal, found = case.model.robot.nominal, possible.theta
    if nominal is None or found is None:
        raise SystemExit("the robot model has no inertias, or the consistent fit no links")
    published = np.append(nominal, np.zeros(len(case.model.parameters) - inertial))
    reference, spread = free.base.from_standard(published), np.sqrt(np.diag(free.covariance))
    own = [k for k, lead in enumerate(free.base.independent) if lead < inertial]
    leads = [free.base.parameters[free.base.independent[k]].name for k in own]
    fitted = published_fit(leads)
    print("| leading term | published | published fit | `wls` | ± | off by | from the fit by | `consistent` | off by |")
    print("|---|---|---|---|---|---|---|---|---|")
    away = np.abs([free.beta - reference, possible.beta - reference])[:, own] / spread[own]
    near = np.abs(free.beta[own] - fitted) / spread[own]
    for i, k in enumerate(own):
        print(
            f"| {leads[i]} | {reference[k]:.4f} | {fitted[i]:.4f} | {free.beta[k]:.4f} | {spread[k]:.4f} "
            f"| {away[0, i]:.1f} | {near[i]:.1f} | {possible.beta[k]:.4f} | {away[1, i]:.1f} |"
        )
    print("\nMedian and largest difference in deviations: `wls` from the published ones", end=" ")
    print(f"{summary(away[0])}, from the published fit {summary(near)}, `consistent` {summary(away[1])}.")
    print("\n| link | published | smallest eigenvalue | `consistent` | smallest eigenvalue |")
    print("|---|---|---|---|---|")
    for i, link in enumerate(case.model.robot.links):
        cells = []
        for theta in (published, found):
            body = Inertia.from_vector(theta[10 * i : 10 * i + 10])
            least = float(np.linalg.eigvalsh(body.pseudo)[0])
            cells += ["possible" if least > 0 else "impossible", f"{least:.2g}"]
        print(f"| {link.name} | {' | '.join(cells)} |")
    print(f"\nBroken conditions of the published parameters: {len(list(broken_conditions(case.model, published)))}")


def tx40() -> None:
    """Print our value and deviation of each published base parameter."""
    case = read_case(CASES / "tx40.yaml")
    log = [case.read(file) for file in case.train]
    estimate = identify(case.model, log, "wls", case.preprocessing)
    base, links = estimate.base, [link.name for link in case.model.robot.links]
    names, joints = [p.name for p in base.parameters], list(case.model.robot.joint_names)
    with open(DATA / "staubli_tx40_figaroh" / "reference_TX40_bp_5.csv", newline="") as file:
        rows = [(row[0], float(row[3]), abs(float(row[3]) * float(row[4])) / 100) for row in csv.reader(file)]
    print("| base parameter (leading term) | published | ± | ours | ± | off by |")
    print("|---|---|---|---|---|---|")
    off, missing = [], []
    for text, value, deviation in rows:
        lead = text.split()[0]
        if lead == "fs6":  # the sign of joint 6 alone: no motor of ours turns so
            missing.append(lead)
            continue
        wanted = translated(text, names, links, joints)
        weights, share = in_ours(base.matrix, wanted)
        if share > OURS:
            missing.append(f"{lead} ({share:.2g})")
            continue
        ours, spread = float(weights @ estimate.beta), float(np.sqrt(weights @ estimate.covariance @ weights))
        off.append(abs(ours - value) / np.hypot(deviation, spread))
        print(f"| {lead} | {value:.4g} | {deviation:.2g} | {ours:.4g} | {spread:.2g} | {off[-1]:.1f} |")
    print(
        f"\n{len(off)} of {len(rows)} carried over; median and largest difference: {summary(np.array(off))};", end=" "
    )
    print(f"within 2 deviations: {np.mean(np.array(off) <= 2):.0%}; not among ours: {', '.join(missing) or 'none'}.")


def translated(text: str, names: list[str], links: list[str], joints: list[str]) -> np.ndarray:
    """Return a published parameter in our standard ones: of motor 6, which turns with joints 5 and 6.

    FIGAROH gives each joint a term of its own and the coupling another: torque 5 has fv5 dq5 + fvm6 dq6, torque 6 has
    fv6 dq6 + fvm6 dq5. Ours are those of the motors, torque 5 has Fv5 dq5 + Fv6 (dq5 + dq6): fv5 = Fv5 + Fv6 and
    fv6 = fvm6 = Fv6; so for inertia. Coulomb friction alike but for fs, whose sign is that of each joint's own speed.
    """
    symbol = text.strip()
    if symbol in ("fvm6", "Iam6", "fsm6"):
        return combination({"fvm6": "fv6", "Iam6": "Ia6", "fsm6": "fs6"}[symbol], names, links, joints)
    found = combination(text, names, links, joints)
    for mine in ("Fv", "Ia"):
        fifth, sixth = (names.index(f"{mine}[{joints[k]}]") for k in (4, 5))
        found[sixth] += found[fifth]
    return found


def summary(values: np.ndarray) -> str:
    """Return median and largest value."""
    return f"{np.median(values):.1f} and {np.max(values):.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help="panda, tx40; default: both")
    chosen = parser.parse_args().robots or ["panda", "tx40"]
    for name, printed in (("panda", panda), ("tx40", tx40)):
        if name in chosen:
            printed()
            print()


if __name__ == "__main__":
    main()
