"""Pictures of a frame: clouds, objects, buildings, the ROI and the vehicle in 3D."""
