"""Sections of a sweep's report, one a file."""
