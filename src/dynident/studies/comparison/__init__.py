"""Many estimators on one problem, side by side."""
