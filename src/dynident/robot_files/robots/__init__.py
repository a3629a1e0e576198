"""Robots that ship, and the published numbers of the ER-16."""
