"""Logs: formats, vendors' profiles, units and preprocessing."""
