"""Results of a plan: tables, pictures, promotion, the run folder and the state."""
