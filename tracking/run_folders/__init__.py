"""Run folders of sweeps and searches: one model for each file, read and checked."""
