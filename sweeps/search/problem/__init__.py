"""The problem of a search: space, constraints and the objective value of a rig."""
