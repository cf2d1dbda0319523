"""The question of a search: space, constraints, and what a rig is worth."""
