"""Which objects a rig probably finds: cells of their surfaces that it hits, and a curve."""
