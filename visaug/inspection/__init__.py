"""What pattern is in a handful of frames: fixed or new in each, of rows, columns, pixels or the whole, without a camera file."""

from visaug.inspection.finding import Finding, Inspection, Measurement
from visaug.inspection.run import inspect

__all__ = ["Finding", "Inspection", "Measurement", "inspect"]
