"""What is chosen by cross-validation: friction, smoothing widths, cut-off and delay."""
