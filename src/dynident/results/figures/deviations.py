"""Figure of relative deviations: how well each parameter is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynident.arrays import Array
from dynident.results.figures import svg
from dynident.results.figures.chart import WIDTH
from dynident.results.figures.scales import LogScale
from dynident.results.text import format_percent, label, shorten

_STEP = 19.0
_NAMES = 0.36  # share of the width that names may take


def deviation_chart(names: Sequence[str], fractions: Array, limits: Sequence[float] = (), width: float = WIDTH) -> str:
    """Return bars of relative standard deviations on a logarithmic axis, in the order given.

    Args:
        names: Of the parameters.
        fractions: Standard deviation over absolute value, shape (K,); infinite ones fill the axis.
        limits: Fractions at which vertical lines stand.
        width: Of the figure.
    """
    finite = [100.0 * f for f in [*fractions, *limits] if np.isfinite(f) and f > 0] or [1.0]
    low = 10.0 ** np.floor(np.log10(max(min(finite), 1e-4)) - 1e-9)
    high = max(10.0 ** np.ceil(np.log10(min(max(finite), 1e5)) - 1e-9), 10 * low)
    shown = [shorten(label(name), int(_NAMES * width / svg.LETTER)) for name in names]
    left = 10 + max((svg.breadth(text) for text in shown), default=0.0)
    scale = LogScale(float(low), float(high), left, width - 56.0)
    top, bottom = 28.0, 28.0 + _STEP * len(shown)
    body = [svg.element("g", svg.words("Relative standard deviation", 0, 15, "ink"), {"font-weight": "600"})]
    for tick in scale.ticks(56.0):
        x = float(scale.at(np.array(tick.value)))
        body += [svg.rule(x, top, x, bottom), svg.words(tick.text, x, bottom + 16, anchor="middle")]
    for limit in limits:
        x = float(scale.at(np.array(100.0 * limit)))
        body.append(svg.stroke(svg.track(np.array([x, x]), np.array([top, bottom])), 0, 1.0, dashed=True))
    for k, (name, text, fraction) in enumerate(zip(names, shown, fractions, strict=True)):
        y = top + _STEP * (k + 0.5)
        end = float(np.clip(scale.at(np.array(100.0 * min(fraction, 1e9) if fraction > 0 else low)), left, scale.end))
        body.append(svg.words(text, left - 8, y + 4.5, anchor="end", full=name if text != name else ""))
        body.append(
            svg.filled(f"M{svg.number(left)} {svg.number(y - 5.5)}H{svg.number(end)}v11H{svg.number(left)}z", 1, 0.75)
        )
        body.append(svg.words(format_percent(float(fraction)), end + 6, y + 4.5, "ink", halo=True))
    body.append(svg.words("std / |value| [%]", width - 12, bottom + 33, anchor="end"))
    worst = "; ".join(f"{label(n)} {format_percent(float(f))}" for n, f in list(zip(names, fractions, strict=True))[:5])
    return svg.drawing(
        width, bottom + 40, "".join(body), "Relative standard deviation", f"First of {len(names)}: {worst}."
    )
