"""The report of a sweep, and of several compared: HTML pages that open without a network."""
