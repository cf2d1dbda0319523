"""Corrections of the package: a YAML file each, whose name `correction:` takes."""
