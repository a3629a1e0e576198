"""The studio: a local web page over the verbs of the command line. Nothing below knows it."""
