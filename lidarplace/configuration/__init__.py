"""Settings that people write: what they are made of, YAML, placements and sensors."""
