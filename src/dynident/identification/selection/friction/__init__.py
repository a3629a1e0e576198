"""Friction found from logs: parts and their non-linear fields by held-out samples, and the load."""
