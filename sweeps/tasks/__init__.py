"""Units of work: the functions of the stages, and the keys that name their results."""
