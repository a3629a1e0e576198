"""The cut-off of the filter on both sides: chosen from the logs, and what the estimate owes to it."""
