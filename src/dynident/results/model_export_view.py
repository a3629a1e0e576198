"""What an export of a model shows on the terminal: the proof as a table, what is left out in a few lines."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from dynident.exports.models import ModelExport, Proof
from dynident.results.text import MISSING, Column, Table, format_number, label


def proofs_table(proofs: Sequence[Proof], units: Collection[str]) -> Table:
    """Return the largest differences of torques, of some units, by engine, those not asked with the reason."""
    rows = []
    for proof in proofs:
        if proof.difference is None or proof.relative is None:
            rows.append((proof.engine, "not proved", MISSING, MISSING))
        else:
            rows.append((proof.engine, proof.what, f"{proof.difference:.1e}", f"{proof.relative:.1e}"))
    columns = (
        Column("loaded again by"),
        Column("compared"),
        Column("difference", " or ".join(sorted(set(units), reverse=True)), numeric=True),
        Column("relative", numeric=True),
    )
    states = max((proof.states for proof in proofs), default=0)
    allowed = " or ".join(f"{limit:.0e}" for limit in sorted({proof.allowed for proof in proofs if proof.states}))
    note = f"largest difference of a torque on {states} random states, at most {allowed or 'nothing'} allowed"
    return Table(columns, tuple(rows), note)


def not_proved_lines(proofs: Sequence[Proof]) -> Iterator[str]:
    """Yield why engines were not asked."""
    for proof in proofs:
        if proof.why_not:
            yield f"not proved with {proof.engine}: {label(proof.why_not)}"


def left_out_lines(export: ModelExport) -> Iterator[str]:
    """Yield what the format cannot hold: the coefficients by joint, and the torque that goes with them."""
    if not export.left_out:
        return
    by_joint: dict[str, list[str]] = {}
    for term in export.left_out:
        by_joint.setdefault(term.joint, []).append(f"{term.symbol} = {term.value:.4g} {term.unit}".rstrip())
    yield f"\nleft out of {export.files[0]}, and in {export.files[-1]}:"
    for joint, terms in by_joint.items():
        lost = export.neglected.get(joint)
        size = (
            "" if lost is None else f"; torque of the file off by {format_number(lost, 3)} {export.units[joint]} (rms)"
        )
        yield f"  {label(joint)}: {', '.join(terms)}{size}"
