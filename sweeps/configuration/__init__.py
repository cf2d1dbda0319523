"""Configuration: the settings of a sweep and of a search, their files and the grid."""
