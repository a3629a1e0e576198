"""Estimate files and files of prior parameters."""
