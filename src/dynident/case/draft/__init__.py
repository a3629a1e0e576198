"""Drafting a case file: what the columns of a log are, what its values say, and the text that is written."""
