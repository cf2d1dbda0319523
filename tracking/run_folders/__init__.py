"""The folders that sweeps and searches leave: one model for each file, read and checked."""
