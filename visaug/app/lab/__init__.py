"""An interactive page on loopback: compare, diagnose, add and remove effects by hand."""

from visaug.app.lab.bench import Bench, load_own
from visaug.app.lab.server import application, serve

__all__ = ["Bench", "application", "load_own", "serve"]
