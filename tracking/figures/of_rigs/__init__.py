"""Figures of single rigs."""
