"""Questions about a sweep, each answered by a table or a number."""
