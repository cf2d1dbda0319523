"""The result of a search: one HTML file that opens without a network."""

from tracking.search_report.build import build_search_report

__all__ = ["build_search_report"]
