"""Pictures (one function, one figure) and one-file HTML reports of results."""

from visaug.report.characterized import write_characterization
from visaug.report.inspected import write_inspection
from visaug.report.pages import write_comparison, write_diagnosis
from visaug.report.pictures import write_picture_comparison
from visaug.report.sheet import sheet_json, write_sheet

__all__ = [
    "sheet_json",
    "write_characterization",
    "write_comparison",
    "write_diagnosis",
    "write_inspection",
    "write_picture_comparison",
    "write_sheet",
]
