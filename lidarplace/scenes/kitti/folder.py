"""Where things lie in a KITTI-format folder, and what becomes of a fault in them."""

from pathlib import Path

from lidarplace.base.errors import InputError


def frame_name(frame: int) -> str:
    """The name of the files of a frame, without suffix."""
    return f"{frame:06d}"


def part(folder: Path, name: str) -> Path:
    """The folder `name` of a data set, which lies in `training` or in `folder` itself."""
    training = folder / "training"
    return (training if training.is_dir() else folder) / name


def fault(message: str, skipped: list[str] | None) -> None:
    """Add to what is skipped, if that is asked for; otherwise the first fault is an InputError."""
    if skipped is None:
        raise InputError(message)
    skipped.append(message)
