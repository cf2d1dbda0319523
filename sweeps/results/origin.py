"""Which configuration a run folder belongs to: its file, and where its scene comes from."""

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
"""Keys of a scene that say which one it is; the others say how much of it."""


def check_origin(sweep: Sweep) -> None:
    """Raise InputError if the run folder has the results of another file, or of another scene.
    One that was moved with its folder, or whose file is gone, may go on."""
    folder, now = sweep.common.output / sweep.common.name, _origin(sweep)
    before = _recorded(folder)
    for key in ("file", *_SCENE):
        known, new = before.get(key), now.get(key)
        if known is None or new is None or known == new:
            continue
        is_path = key in ("file", "folder")
        if is_path and not (folder / known).exists():
            continue
        if is_path:
            known, new = (os.path.relpath((folder / own).resolve()) for own in (known, new))
        raise InputError(
            "the run folder has the results of another " + ("file" if key == "file" else "scene"),
            place=folder,
            key="" if key == "file" else f"scene.{key}",
            expected=known,
            found=new,
            fix=f"set another name, such as --set name={sweep.common.name}_2",
        )


def record_origin(sweep: Sweep) -> None:
    """Check, and write what a later command is compared with. Raises InputError."""
    check_origin(sweep)
    folder = sweep.common.output / sweep.common.name
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / FILE, json.dumps(_recorded(folder) | _origin(sweep), indent=1))


def _recorded(folder: Path) -> dict[str, Any]:
    path = folder / FILE
    recorded: dict[str, Any] = read_json(path) if path.is_file() else {}
    return recorded


def _origin(sweep: Sweep) -> dict[str, Any]:
    """Paths are relative to the run folder, with which they may be moved. A file in the run folder,
    such as its config.yaml, is none of its origins."""
    folder = (sweep.common.output / sweep.common.name).resolve()
    scene = sweep.points[0].point.scene.model_dump(mode="json", include=set(_SCENE))
    varied = {axis.partition(".")[2] for axis in sweep.axes if axis.startswith("scene.")}
    origin = {key: own for key, own in scene.items() if key not in varied}
    if "scene" in sweep.axes:
        origin = {}
    if "folder" in origin:
        origin["folder"] = os.path.relpath(Path(origin["folder"]).resolve(), folder)
    file = sweep.path.resolve()
    return (
        origin if file.is_relative_to(folder) else {"file": os.path.relpath(file, folder)} | origin
    )
