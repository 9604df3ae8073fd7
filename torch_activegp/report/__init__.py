"""The report of a diagnosis: one HTML file that a lab can mail, read on a phone and print."""

from torch_activegp.report.page import render_report, write_report

__all__ = ["render_report", "write_report"]
