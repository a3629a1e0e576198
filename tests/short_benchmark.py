"""The benchmark file of two noise levels and two methods on which the command is tried."""

from __future__ import annotations


def benchmark_text(robot: str, friction: str, draws: int) -> str:
    """Return a benchmark of a robot (a name or a path) with a list of friction parts, in YAML's flow style."""
    return f"""benchmark: 1
title: mine
robots: [{robot}]
friction: {friction}
motion: {{period_s: 4, starts: 1, time_limit_s: 1}}
cell: {{controller: {{pd: {{rate: 250}}}}, recorder: {{rate: 250}}}}
rates_hz: [125]
duration_s: 4
noise:
  - {{name: low, position: 1.0e-5, torque: 0.1}}
  - {{name: high, position: 1.0e-4, torque: 0.1}}
draws: {draws}
preparations: {{filtered: {{filter: {{butterworth: {{cutoff_hz: 20}}}}}}}}
methods: {{filtered: [ols, wls]}}
"""
