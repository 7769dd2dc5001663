"""Which physical effect is missing: name it, add it, watch the error fall."""

from visaug.diagnosis.residue import Residue
from visaug.diagnosis.result import Diagnosis, Estimate, Ranked, Step
from visaug.diagnosis.search import SETS, diagnose
from visaug.diagnosis.session import Session, Setup

__all__ = ["SETS", "Diagnosis", "Estimate", "Ranked", "Residue", "Session", "Setup", "Step", "diagnose"]
