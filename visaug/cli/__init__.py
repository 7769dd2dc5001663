"""The program `visaug`: parse, call, print; no logic."""

from visaug.cli.root import main

__all__ = ["main"]
