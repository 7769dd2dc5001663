"""Which physical effect is missing: name it, add it, watch the error fall."""

from visaug.diagnosis.residue import Residue
from visaug.diagnosis.result import Diagnosis, Estimate, Ranked, Step
from visaug.diagnosis.search import diagnose

__all__ = ["Diagnosis", "Estimate", "Ranked", "Residue", "Step", "diagnose"]
