"""Zones of regulations as files, each number with the paragraph that it is from."""
