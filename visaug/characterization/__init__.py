"""Camera parameters with intervals, measured from frames."""

from visaug.characterization.result import Characterization
from visaug.characterization.run import characterize
from visaug.statistics.findings import Estimate

__all__ = ["Characterization", "Estimate", "characterize"]
