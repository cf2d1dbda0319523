"""Sweeps and searches: configuration, tasks, execution, results and the command line."""
