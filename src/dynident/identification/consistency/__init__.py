"""Physical consistency: conditions, priors, the convex program and its proof, verdicts and labels."""
