"""The studio: place LiDARs on a page of the browser and see at once what the rig sees."""
