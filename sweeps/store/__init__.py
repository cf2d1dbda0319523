"""Results by key, in a folder or at a URL: kept, locked, cleaned, and checkpoints next to them."""
