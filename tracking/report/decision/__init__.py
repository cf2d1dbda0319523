"""The page that decides: which rig, how sure, what each finds and where it is blind."""
