"""Heads, from features to boxes: anchors, proposals, second stages, losses."""
