"""The command line ``rfea``: thin commands that open a campaign, run its stages and print what came of it."""

from rfea_vision.cli.root import main

__all__ = ["main"]
