"""The plan of a sweep: tasks for the points of a grid."""
