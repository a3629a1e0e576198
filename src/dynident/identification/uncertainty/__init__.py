"""How sure an estimate is, and how far to trust it: covariances, bootstrap, diagnostics, cross-validation."""
