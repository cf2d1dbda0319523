"""Predictors of other groups, a file each, written from what their papers and code state.

Each maps a rig and the log of its training traffic to numbers by class, high for good rigs.
"""
