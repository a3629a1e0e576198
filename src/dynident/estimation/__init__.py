"""The estimation: problem, estimators, estimate, validation."""
