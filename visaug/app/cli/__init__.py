"""The program `visaug`: parse, call, print; no logic."""

from visaug.app.cli.root import main

__all__ = ["main"]
