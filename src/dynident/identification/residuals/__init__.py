"""Passes over rows and residuals: outliers, colour, what joints share, stretches of time."""
