"""Box logs: which objects were around the vehicle in every frame."""
