"""Pictures (one function, one figure) and one-file HTML reports of results."""

from visaug.report.pages import write_characterization, write_comparison, write_diagnosis

__all__ = ["write_characterization", "write_comparison", "write_diagnosis"]
