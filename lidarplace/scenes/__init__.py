"""Where box logs come from: kinds of scenes, simulators and data sets."""
