"""LiDARs that can be bought, as their makers describe them: one file of data, and its reader."""
