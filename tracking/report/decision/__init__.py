"""Decision page: which rig, how certain, what each finds and where it is blind."""
