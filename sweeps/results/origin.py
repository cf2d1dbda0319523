"""Origin of a run folder: the file and the scene of the configuration that it belongs to."""

import json
import os
from pathlib import Path
from typing import Any

from lidarplace.base.errors import InputError
from lidarplace.files.atomic import write_text
from lidarplace.files.json_file import read_json
from sweeps.configuration.grid import Sweep

FILE = ".origin.json"
_SCENE = ("source", "folder", "towns", "seed")
"""Keys of a scene that identify it; the others say how much of it is used."""


def check_origin(sweep: Sweep) -> dict[str, Any]:
    """Compare the origin of the run folder with that of the sweep, and return both together.

    Raises InputError if the folder has the results of another file, or of another scene. One that
    was moved with its folder, or whose file is gone, may continue."""
    folder, now = sweep.common.output / sweep.common.name, _origin(sweep)
    before = _recorded(folder)
    for key in ("file", *_SCENE):
        old, new = before.get(key), now.get(key)
        if old is None or new is None or old == new:
            continue
        if key in ("file", "folder"):
            if not (folder / old).exists():
                continue
            old, new = (os.path.relpath((folder / path).resolve()) for path in (old, new))
        raise InputError(
            "the run folder has the results of another " + ("file" if key == "file" else "scene"),
            place=folder,
            key="" if key == "file" else f"scene.{key}",
            expected=old,
            found=new,
            fix=f"set another name, such as --set name={sweep.common.name}_2",
        )
    return before | now


def record_origin(sweep: Sweep) -> None:
    """Check the origin, and write what a later command is compared with. Raises InputError."""
    origin = check_origin(sweep)
    folder = sweep.common.output / sweep.common.name
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / FILE, json.dumps(origin, indent=1))


def _recorded(folder: Path) -> dict[str, Any]:
    """Read what `record_origin` wrote, {} in a new folder. Raises InputError if it is damaged."""
    path = folder / FILE
    origin = read_json(path) if path.is_file() else {}
    if not isinstance(origin, dict):
        raise InputError(place=path, expected="a mapping of keys", fix="remove it")
    return origin


def _origin(sweep: Sweep) -> dict[str, Any]:
    """Compute the origin; paths are relative to the run folder, with which they may be moved.

    A file in the folder, such as its config.yaml, is not an origin."""
    folder = (sweep.common.output / sweep.common.name).resolve()
    scene = sweep.points[0].point.scene.model_dump(mode="json", include=set(_SCENE))
    varied = {axis.partition(".")[2] for axis in sweep.axes if axis.startswith("scene.")}
    is_varied = "scene" in sweep.axes
    origin = {k: value for k, value in scene.items() if not is_varied and k not in varied}
    if "folder" in origin:
        origin["folder"] = os.path.relpath(Path(origin["folder"]).resolve(), folder)
    if not (file := sweep.path.resolve()).is_relative_to(folder):
        origin["file"] = os.path.relpath(file, folder)
    return origin
