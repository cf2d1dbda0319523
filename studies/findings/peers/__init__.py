"""Predictors of other groups, a file each: numbers of a rig, by class, high for good rigs."""
