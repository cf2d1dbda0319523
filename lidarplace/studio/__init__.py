"""The studio: place LiDARs in the browser and see immediately what the rig sees."""
