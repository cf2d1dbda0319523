"""Parts that commands share: help and mistakes, options, and text in a terminal."""
