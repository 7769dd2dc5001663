"""What every room builds on: random streams, errors, whole files, strict documents, progress."""

__version__ = "0.3.0"
