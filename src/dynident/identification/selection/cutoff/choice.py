"""The cut-off of the Butterworth filter on both sides, chosen from the logs.

A low cut-off leaves few independent rows, and takes from the positions what friction needs; a high one lets in the
noise of the torques and what the model does not have, and the noise of the positions, which two differentiations make
grow with the square of the frequency: it gives a variance and, being in the columns, a bias that no length of the log
removes. Cut-offs half an octave apart are tried, from the band that the motion excites upwards, and each is judged by
the squared error of the torque that it predicts: variance plus the squares of both biases (docs/which-filter.md,
"Filters"). Around its least the error is flat; among the cut-offs that are within a tenth of the least, which the data
hardly tell apart, the geometric middle is taken, the farthest from both slopes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, preprocess, resample
from dynident.data.preprocessing._spectra import Spectra, spectra_of
from dynident.data.preprocessing.butterworth import STATED_HZ
from dynident.errors import DynidentError
from dynident.identification.problem.choices import CutoffRecord
from dynident.identification.selection.cutoff.candidates import Bench, CutoffCandidate, stretch_of
from dynident.identification.selection.delay import find_delays
from dynident.identification.selection.friction.load import without_load
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel

#: From one cut-off to the next.
RATIO = 2.0**0.5

#: Highest cut-off as a share of the sampling rate; positions then pass up to 0.4 of it.
HIGHEST = 0.2

#: Cut-offs up to so many times the one of least variance and noise bias are asked for the bias of their filter.
BEYOND = 2.1

#: Motion is imitated with the detail that passes up to so many times the least variance and noise bias.
SHARP = 2.0

#: Time in s, over all logs, that the choice looks at.
LONGEST_S = 120.0

#: The error above its least up to which cut-offs count as equal, and that ends the search when seen twice in a row.
EQUAL, HOPELESS = 1.1, 4.0


@dataclass(frozen=True)
class Judged:
    """A candidate and its squared error in units of the residual's deviation of each joint, averaged over rows.

    Attributes:
        hertz: The cut-off.
        variance: Of the estimate's random error.
        noise_bias: By the noise of the positions, squared.
        filter_bias: By the filter of the positions, squared.
    """

    hertz: float
    variance: float
    noise_bias: float
    filter_bias: float

    @property
    def total(self) -> float:
        """Variance and squared biases."""
        return self.variance + self.noise_bias + self.filter_bias


@dataclass(frozen=True)
class CutoffChoice:
    """A cut-off and why.

    Attributes:
        hertz: The cut-off.
        low: Least of those that are as good.
        high: Greatest of those.
        judged: All that were tried; empty where the logs determine the parameters at none.
        spectra: Of the longest log.
        joints: Names of the joints.
        share: Share of the recorded time that was looked at.
    """

    hertz: float
    low: float
    high: float
    judged: tuple[Judged, ...]
    spectra: Spectra
    joints: tuple[str, ...]
    share: float

    @property
    def reason(self) -> str:
        """The choice in one sentence."""
        if not self.judged:
            return f"{self.hertz:g} Hz, as nothing could be tried: the logs determine the parameters at no cut-off"
        below = f"below it too little passes ({_most(self.judged[0])})" if self.low > self.judged[0].hertz else ""
        above = f"above it {_most(self.judged[-1])} grows" if self.high < self.judged[-1].hertz else ""
        grounds = " and ".join(filter(None, (below, above))) or "nothing that was tried is worse"
        return f"{self.hertz:g} Hz, the middle of {self.low:.3g} to {self.high:.3g} Hz, which are as good: {grounds}"

    def record(self) -> CutoffRecord:
        """Return what the estimate states of the choice, with its table and the spectra."""
        spectra = {"hertz": self.spectra.hertz.tolist(), "joints": [self._joint(k) for k in range(len(self.joints))]}
        return CutoffRecord(
            self.hertz,
            (self.low, self.high),
            self.reason,
            self.share,
            tuple(
                {
                    "cutoff_hz": each.hertz,
                    "variance": each.variance,
                    "noise_bias": each.noise_bias,
                    "filter_bias": each.filter_bias,
                    "total": each.total,
                }
                for each in self.judged
            ),
            spectra,
        )

    def _joint(self, joint: int) -> dict[str, Any]:
        spectra = self.spectra
        return {
            "name": self.joints[joint],
            "position": spectra.position[:, joint].tolist(),
            "torque": None if spectra.torque is None else spectra.torque[:, joint].tolist(),
            "position_noise": float(spectra.floor[joint]),
            "position_noise_std": float(spectra.deviation[joint]),
            "excited_hz": float(spectra.excited_hz[joint]),
            "noise_from_hz": float(spectra.valley_hz[joint]),
        }


def _most(judged: Judged) -> str:
    parts = {
        "the variance": judged.variance,
        "the bias by the noise of the positions": judged.noise_bias,
        "the bias by the filter of the positions": judged.filter_bias,
    }
    return max(parts, key=lambda name: parts[name])


def with_cutoff(
    model: DynamicModel, logs: Sequence[Log], how: Preprocessing, progress: Callable[[str], None] = lambda step: None
) -> tuple[Preprocessing, CutoffRecord | None]:
    """Return a preparation whose cut-off is a number, and its choice; as it is, and None, where it is one already.

    Args:
        model: The model that is to be identified.
        logs: Raw logs, joints in the order of the robot.
        how: The preparation.
        progress: Called with the step in words.
    """
    if not how.filter.is_open:
        return how, None
    progress("cut-off of the filter")
    choice = choose_cutoff(model, logs, how)
    return replace(how, filter=how.filter.with_cutoff(choice.hertz)), choice.record()


def choose_cutoff(model: DynamicModel, logs: Sequence[Log], how: Preprocessing) -> CutoffChoice:
    """Return the cut-off that the logs ask for; arguments as of :func:`with_cutoff`.

    Raises:
        LogMismatch: Time of a log does not run forward, or it is too short.
    """
    even = [resample(log, how.longest_gap_s) for log in logs]
    seen, share = stretch_of(even, LONGEST_S)
    spectra = [spectra_of(log) for log in seen]
    longest = spectra[int(np.argmax([log.duration for log in seen]))]
    rate = min(log.rate for log in even)
    simple = without_load(model)
    judged: tuple[Judged, ...] = ()
    try:
        pilot = replace(how, filter=how.filter.with_cutoff(min(STATED_HZ, rate / 12)))
        base = base_parameters(simple)
        delays = [0.0 if how.delay_s is None else how.delay_s] * len(seen)
        if how.delay_s is None:
            plain = [preprocess(log, pilot) for log in seen]
            delays = [delay.applied for delay in find_delays(simple, base, plain)[0]]
        noise = tuple(each.deviation for each in spectra)
        bench = Bench(simple, base, seen, tuple(delays), how, noise, share)
        lowest = 0.5 * max(float(each.excited_hz.max()) for each in spectra)
        judged = _tried(bench, lowest, HIGHEST * rate)
    except DynidentError:  # the fit itself says better what is wrong with such a log
        pass
    if not judged:
        hertz = min(STATED_HZ, HIGHEST * rate)
        return CutoffChoice(hertz, hertz, hertz, (), longest, logs[0].joints, share)
    low, high = _equals(judged)
    middle = float(f"{(low * high) ** 0.5:.2g}")
    return CutoffChoice(middle, low, high, judged, longest, logs[0].joints, share)


def _tried(bench: Bench, lowest: float, highest: float) -> tuple[Judged, ...]:
    """Return cut-offs from the lowest on until the error has grown beyond hope."""
    found: list[CutoffCandidate] = []
    hertz = min(lowest, highest)
    while hertz <= highest * (1 + 1e-9):
        one = bench.candidate(hertz)
        if one is not None:
            found.append(one)
            errors = [sum(each.error(metric_of(found))) for each in found]
            if len(errors) > 2 and min(errors[-2:]) > HOPELESS * min(errors):
                break
        hertz *= RATIO
    if not found:
        return ()
    errors = [each.error(metric_of(found)) for each in found]
    best = int(np.argmin([sum(error) for error in errors]))
    sharp = found[sharpest_of(errors, best)].hertz
    imitation = bench.imitated(found[best].beta, sharp)
    judged = []
    for one, (variance, noise) in zip(found, errors, strict=True):
        known = one.hertz <= BEYOND * sharp  # above, the imitation is as smooth as all filters see it
        off = imitation.filter_bias(found[best].beta, one.hertz) if known else np.zeros(len(one.beta))
        judged.append(Judged(one.hertz, variance, noise, float(off @ found[best].gram @ off)))
    return tuple(judged)


def sharpest_of(errors: Sequence[tuple[float, float]], best: int) -> int:
    """Return the highest cut-off from the best on up to which the error is at most twice the least.

    What a filter takes from a reversal shows only in an imitation that still has it; noise that is left in its motion
    would be taken for such detail.
    """
    last = best
    while last + 1 < len(errors) and sum(errors[last + 1]) < SHARP * sum(errors[best]):
        last += 1
    return last


def metric_of(found: Sequence[CutoffCandidate]) -> Array:
    """Return the products that all are judged by: those of the candidate that is best by them.

    Several may be; the highest one's is sought from above. A cut-off within the band of the motion leaves a smaller
    torque to be predicted, and may be the best by its own products alone.
    """
    gram = found[-1].gram
    for _ in range(3):
        gram = found[int(np.argmin([sum(each.error(gram)) for each in found]))].gram
    return gram


def _equals(judged: Sequence[Judged]) -> tuple[float, float]:
    """Return the ends of the cut-offs around the best that are as good."""
    totals = np.array([each.total for each in judged])
    first = last = int(np.argmin(totals))
    while first > 0 and totals[first - 1] <= EQUAL * totals.min():
        first -= 1
    while last < len(totals) - 1 and totals[last + 1] <= EQUAL * totals.min():
        last += 1
    return judged[first].hertz, judged[last].hertz
