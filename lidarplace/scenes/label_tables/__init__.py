"""Box logs from a company's label files, with a mapping of their columns."""
