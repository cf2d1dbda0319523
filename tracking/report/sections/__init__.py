"""The sections of a sweep's report, one a file."""
