"""The command line as a module: ``python -m dynident`` is the command ``dynident``."""

from dynident.cli.main import entry_point

if __name__ == "__main__":
    entry_point()
