"""An identified inertia shared out among the links of a file that it is the sum of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dynident.model.inertia import Inertia
from dynident.results.model_exporters.subject.identified import Identified
from dynident.results.model_exporters.writing.placement import Placement

#: Share of the smallest eigenvalue of the sum's pseudo-inertia that the moving link keeps where others keep theirs.
ROOM = 0.01

#: Share of the trace of a pseudo-inertia that an eigenvalue below zero may have: plates and points are at the edge.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Shares:
    """What each link of a file gets.

    Attributes:
        inertias: New inertia about the link's own frame; None takes its inertia out. Others stay as they are.
        notes: Where a sum goes, one sentence for each link of the model that is more than one of the file.
    """

    inertias: Mapping[str, Inertia | None]
    notes: tuple[str, ...]


def shared(subject: Identified, placement: Placement, lump: bool) -> Shares:
    """Share out the inertia of each link of the model.

    Links that are fixed to a moving one, or locked behind it, keep the inertia that the file states, and the moving
    one gets the rest, where that and they are possible bodies. Else fixed ones lose theirs to it; locked ones, which
    move in the file and need a mass, keep the same part of theirs, half of the largest that leaves a possible body.

    Args:
        subject: The identified model.
        placement: The links of the file on its links.
        lump: Whether fixed ones lose theirs in any case.
    """
    inertias: dict[str, Inertia | None] = {}
    notes: list[str] = []
    for i, link in enumerate(subject.model.robot.links):
        others = [n for n in placement.on(i) if n != link.name and _weighs(placement.bodies[n])]
        fixed = [name for name in others if not placement.placed[name].behind_lock]
        held = [name for name in others if placement.placed[name].behind_lock]
        kept = [name for name in others if name in held or not (lump or _is_none(placement.bodies[name]))]
        rest = _less(subject.bodies[i], placement, kept, 1.0)
        scale = 1.0
        if kept and not _has_room(rest, subject.bodies[i]):
            kept, scale = held, 1.0
            rest = _less(subject.bodies[i], placement, kept, scale)
            while kept and not _has_room(rest, subject.bodies[i]):
                scale *= 0.5
                rest = _less(subject.bodies[i], placement, kept, scale)
            for name in kept if scale < 1.0 else []:
                inertias[name] = _scaled(placement.bodies[name], scale)
        inertias[link.name] = rest
        gone = [name for name in fixed if name not in kept]
        inertias |= dict.fromkeys(gone)
        if others:
            notes.append(_sentence(link.name, kept, gone, scale))
        unreal = [name for name in others if _is_none(placement.bodies[name])]
        if unreal:
            notes.append(f"no body has the inertia that the file states for {some(unreal)}")
    return Shares(inertias, tuple(notes))


def _has_room(rest: Inertia, total: Inertia) -> bool:
    least = ROOM * float(np.linalg.eigvalsh(total.pseudo)[0])
    return bool(np.linalg.eigvalsh(rest.pseudo)[0] >= least)


def _is_none(body: Inertia | None) -> bool:
    """Return whether no body has the inertia that a file states."""
    return body is not None and not body.is_consistent(-ROUNDING)


def _weighs(body: Inertia | None) -> bool:
    return body is not None and bool(body.vector.any())


def _less(total: Inertia, placement: Placement, kept: list[str], scale: float) -> Inertia:
    vector = total.vector.copy()
    for name in kept:
        body, place = placement.bodies[name], placement.placed[name]
        assert body is not None
        vector -= scale * body.moved(place.rotation, place.translation).vector
    return Inertia.from_vector(vector)


def _scaled(body: Inertia | None, scale: float) -> Inertia:
    assert body is not None
    return Inertia.from_vector(scale * body.vector)


def _sentence(owner: str, kept: list[str], gone: list[str], scale: float) -> str:
    """Return where the sum of a link and of what hangs on it has gone."""
    parts = []
    if kept:
        part = "" if scale == 1.0 else f" {scale:.3g} times"
        parts.append(f"{some(kept)} keep{'s' if len(kept) == 1 else ''}{part} the inertia of the file")
    if gone:
        parts.append(f"{some(gone)} ha{'s' if len(gone) == 1 else 've'} none any more")
    return f"'{owner}' was identified as one body with what hangs on it: {'; '.join(parts)}; '{owner}' has the rest"


def some(names: Sequence[str], most: int = 4) -> str:
    """Return names with commas, the first of many."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
