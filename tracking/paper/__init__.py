"""Figures of a sweep as files for a paper."""
