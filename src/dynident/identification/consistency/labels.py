"""What each standard parameter stands on: identified, only in combination, or not determined by the data."""

from __future__ import annotations

from dataclasses import dataclass

from dynident.identification.estimate.estimate import Estimate
from dynident.model.base_parameters import COMBINED, IDENTIFIABLE

IDENTIFIED, ONLY_COMBINED, NOT_DETERMINED = "identified", "only in combination", "not determined"

#: Share of data from which a parameter that stands alone in a base parameter is called identified.
MOSTLY_DATA = 0.5

#: Share of data below which one that stands in combinations only counts as not determined.
HARDLY_DATA = 0.1


@dataclass(frozen=True)
class Label:
    """What one standard parameter of an estimate stands on.

    Attributes:
        word: ``identified``: it is a base parameter by itself, and the data leave less than half of the prior's
            variance; ``only in combination``: base parameters hold it together with others; ``not determined``:
            it moves no torque, or the data say little about it, so that prior and bounds place it.
        data_share: 1 less the variance left over the prior's variance; None where the method states none.
    """

    word: str
    data_share: float | None


def labels_of(estimate: Estimate) -> tuple[Label, ...]:
    """Return the label of each standard parameter, p of them; empty where the method found base parameters only."""
    if estimate.theta is None:
        return ()
    shares = estimate.run.data_share or [None] * len(estimate.base.verdicts)
    return tuple(Label(label_word(v, s), s) for v, s in zip(estimate.base.verdicts, shares, strict=True))


def label_word(verdict: str, share: float | None) -> str:
    """Return the word of a label from the verdict of the base parameters and the share of the data."""
    words = {IDENTIFIABLE: (IDENTIFIED, MOSTLY_DATA), COMBINED: (ONLY_COMBINED, HARDLY_DATA)}
    word, least = words.get(verdict, (NOT_DETERMINED, 0.0))
    return word if share is None or share >= least else NOT_DETERMINED
