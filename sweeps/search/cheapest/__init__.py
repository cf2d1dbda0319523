"""The cheapest rig of a grid that meets all requirements: a mixed-integer programme, proven."""
