"""Result of a search: one HTML file that works offline."""
