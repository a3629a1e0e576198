"""The public verbs, with one set of defaults for the library, the command line and the studio."""
