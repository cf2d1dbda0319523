"""Sweeps and searches: configuration, stages, execution, results and the command line."""
