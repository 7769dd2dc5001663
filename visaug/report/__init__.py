"""Pictures (one function, one figure) and one-file HTML reports of results."""

from pathlib import Path
from typing import Any

from visaug.report.characterized import write_characterization
from visaug.report.inspected import write_inspection
from visaug.report.pages import write_comparison, write_diagnosis, write_picture_comparison
from visaug.report.sheet import sheet_json, write_sheet


def write_report(path: Path, result: Any) -> None:
    """Writes the report of a comparison, a comparison of pictures, an inspection or a diagnosis."""
    from visaug.diagnosis import Comparison
    from visaug.inspection import Inspection
    from visaug.pictures.comparison import PictureComparison

    if isinstance(result, Inspection):
        write_inspection(path, result)
    elif isinstance(result, Comparison):
        assert result.frame_set is not None
        write_comparison(path, result, result.camera, result.frame_set, result.seed)
    elif isinstance(result, PictureComparison):
        write_picture_comparison(path, result)
    else:
        write_diagnosis(path, result, result.given, result.frame_set, result.seed)


__all__ = [
    "sheet_json", "write_characterization", "write_comparison", "write_diagnosis", "write_inspection",
    "write_picture_comparison", "write_report", "write_sheet",
]  # fmt: skip
