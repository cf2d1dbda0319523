"""The report of a sweep: one HTML file that opens without a network."""

from tracking.report.build import build_report

__all__ = ["build_report"]
