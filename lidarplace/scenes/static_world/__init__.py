"""Static worlds of scenes, built from recorded clouds: cells that stand still, and the ground."""
