"""Box logs from data sets and from tables of one's own."""
