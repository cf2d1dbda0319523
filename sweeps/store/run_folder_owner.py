"""Which configuration a run folder belongs to: another one would replace its pages."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lidarplace.base.errors import InputError
from lidarplace.files.atomic import write_text
from lidarplace.files.json_file import read_json

_FILE = ".configuration.json"
_LENGTHS = {"routes", "test_routes", "egos_per_run", "frames_per_route"}
"""Keys of a scene that make more of the same traffic."""


def claim_run_folder(folder: Path, config: Path, source: Mapping[str, Any]) -> None:
    """Record that the file `config` fills a run folder.

    `source` is the configuration as plain data after `--set`. Paths are stored relative to the
    folder, so that both may move together; a file that is gone has no claim. Raises InputError: the
    folder belongs to another file, or to the same one with another scene."""
    scene = source.get("scene")
    lasting = scene
    if isinstance(scene, Mapping):
        lasting = {key: value for key, value in scene.items() if key not in _LENGTHS}
    place = os.path.relpath(config.resolve(), folder.resolve())
    claim = {"file": place, "scene": json.loads(json.dumps(lasting, default=str))}
    if (folder / _FILE).exists():
        known = read_json(folder / _FILE)
        other = folder / known["file"]
        fix = f"name this one, such as --set name={folder.name}_2, or remove {folder}"
        if known["file"] != place and other.exists():
            shown = os.path.relpath(other.resolve())
            problem = "belongs to another configuration"
            raise InputError(problem, place=folder, expected=shown, found=str(config), fix=fix)
        if known["scene"] != claim["scene"]:
            problem = "belongs to this configuration with another scene"
            expected, found = (json.dumps(own["scene"]) for own in (known, claim))
            raise InputError(problem, place=folder, expected=expected, found=found, fix=fix)
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / _FILE, json.dumps(claim, indent=1) + "\n")
