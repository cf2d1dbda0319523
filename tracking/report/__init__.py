"""Report of a sweep: HTML pages that open without a network."""
