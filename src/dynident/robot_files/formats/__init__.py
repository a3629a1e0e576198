"""Formats of robot models, one per file: the only files that know a format."""
