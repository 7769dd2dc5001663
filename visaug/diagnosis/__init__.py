"""Which physical effect is missing: name it, add it, watch the error fall."""

from visaug.diagnosis.comparison import Comparison, compare
from visaug.diagnosis.residue import Residue
from visaug.diagnosis.result import Diagnosis, Estimate, Ranked, Step
from visaug.diagnosis.search import SETS, diagnose

__all__ = ["SETS", "Comparison", "Diagnosis", "Estimate", "Ranked", "Residue", "Step", "compare", "diagnose"]
