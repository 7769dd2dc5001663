"""Camera parameters with intervals, measured from frames."""

from visaug.characterization.result import Characterization, Estimate
from visaug.characterization.run import characterize

__all__ = ["Characterization", "Estimate", "characterize"]
