"""Which physical effect is missing: name it, add it, watch the error fall."""

from visaug.comparison.residue import Residue
from visaug.diagnosis.result import Diagnosis, Estimate, Ranked, Step
from visaug.diagnosis.search import SETS, diagnose

__all__ = ["SETS", "Diagnosis", "Estimate", "Ranked", "Residue", "Step", "diagnose"]
