"""Box logs from label files in a company's manner: a mapping says what their columns mean."""
