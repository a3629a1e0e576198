"""The case file: its sections, its value, and its draft."""
