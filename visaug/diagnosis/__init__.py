"""Which physical effect is missing: name it, add it, watch the error fall."""

from visaug.diagnosis.comparison import Comparison, compare
from visaug.diagnosis.empirical import Component
from visaug.diagnosis.residue import Residue
from visaug.diagnosis.result import Diagnosis, FittedValue, Ranked, Step
from visaug.diagnosis.search import SETS, diagnose

__all__ = [
    "SETS",
    "Comparison",
    "Component",
    "Diagnosis",
    "FittedValue",
    "Ranked",
    "Residue",
    "Step",
    "compare",
    "diagnose",
]
