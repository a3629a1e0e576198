"""Checks of logs, causes of what they find, and warnings about an estimate."""
