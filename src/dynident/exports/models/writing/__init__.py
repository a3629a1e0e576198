"""Texts of exported files."""
