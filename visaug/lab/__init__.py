"""An interactive page on loopback: compare, diagnose, add and remove effects by hand."""

from visaug.lab.bench import Bench, load_own
from visaug.lab.server import application, serve

__all__ = ["Bench", "application", "load_own", "serve"]
