"""Advice for a file or folder that is no table of boxes: which reader it is for."""

from pathlib import Path

LAYOUTS = {
    "kitti": ("label_2", "training/label_2"),
    "nuscenes": ("v1.0-*", "scene.json"),
    "argoverse": ("train/*/annotations.feather", "val/*/annotations.feather"),
    "waymo": ("training/lidar_box", "validation/lidar_box"),
    "openlabel": ("*.json",),
}
"""What only a folder for this reader has, the first reader first."""
SUFFIXES = {
    ".json": "`lidarplace convert openlabel` reads OpenLABEL, `convert nuscenes` nuScenes",
    ".txt": "`lidarplace convert kitti` reads a folder of KITTI's labels; call a table .csv",
}


def other_reader(path: Path) -> str:
    """Name the reader, by the suffix of a file or by what is in a folder; empty if unknown."""
    if not path.is_dir():
        return SUFFIXES.get(path.suffix.lower(), "")
    for name, patterns in LAYOUTS.items():
        if any(next(path.glob(pattern), None) for pattern in patterns):
            return f"`lidarplace convert {name}` reads such a folder"
    return ""
