"""The page that compares several sweeps."""
