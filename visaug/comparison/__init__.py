"""Measured frames beside a model's: how far they differ, and where."""

from visaug.comparison.chance import tail_factor
from visaug.comparison.comparison import Comparison, Place, Places, compare, data_frame, places, z_scores
from visaug.comparison.distance import Distance, Error, is_clear
from visaug.comparison.folds import Folds, share_out
from visaug.comparison.laboratory import Laboratory
from visaug.comparison.picture_part import with_a_well
from visaug.comparison.pictures import PictureComparison, compare_pictures

__all__ = [
    "Comparison",
    "Distance",
    "Error",
    "Folds",
    "Laboratory",
    "PictureComparison",
    "Place",
    "Places",
    "compare",
    "compare_pictures",
    "data_frame",
    "is_clear",
    "places",
    "share_out",
    "tail_factor",
    "with_a_well",
    "z_scores",
]
