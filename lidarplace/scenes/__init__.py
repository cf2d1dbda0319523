"""Sources of box logs: kinds of scenes, simulators and data sets."""
