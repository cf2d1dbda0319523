"""Objects of a made-up run, and which of them each trial found."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

FRAMES, ROUTES = 20, 4
CLASSES = ("Car", "Pedestrian")
HEIGHTS = {"Car": 1.5, "Pedestrian": 1.75}


def made_up_objects(
    rng: np.random.Generator, settings: Sequence[Mapping[str, Any]]
) -> list[dict[str, Any]]:
    """Make five cars and five pedestrians in each of twenty frames on four routes, per setting.

    The same individuals are in the five frames of a route."""
    rows: list[dict[str, Any]] = []
    for setting, frame, place in product(settings, range(FRAMES), range(10)):
        name, route = CLASSES[place % 2], frame * ROUTES // FRAMES
        x, y = rng.uniform(1, 19), rng.uniform(-9, 9)
        share = float(rng.choice([0.2, 0.6, 1.0]))
        box = (x, y, HEIGHTS[name] / 2, 4.2, 1.8, HEIGHTS[name])
        row = {"object": len(rows), **setting, "scene": "test", "frame": frame}
        row |= {"route": route, "class": name, "object_id": f"{route}-{place}"}
        row |= dict(zip(("x", "y", "z", "length", "width", "height"), box, strict=True))
        row |= {"yaw": rng.uniform(-np.pi, np.pi), "visibility": share}
        rows.append(row | {"occluded": {1.0: 0, 0.6: 1, 0.2: 2}[share]})
    return rows


def made_up_found(
    rng: np.random.Generator,
    objects: Sequence[Mapping[str, Any]],
    trials: Sequence[Mapping[str, Any]],
    quality: Mapping[str, float],
) -> list[dict[str, Any]]:
    """A better rig finds more."""
    return [
        {"trial": trial["trial"], "object": truth["object"], "points": int(rng.integers(0, 100))}
        | {"found": bool(rng.random() < 0.3 + 0.5 * quality[str(trial["placement"])])}
        for trial, truth in product(trials, objects)
        if all(truth[key] == trial[key] for key in truth.keys() & trial.keys())
    ]


def made_up_frames(
    rng: np.random.Generator,
    objects: Sequence[Mapping[str, Any]],
    rigs: tuple[str, str],
    shown: Sequence[int],
) -> dict[str, np.ndarray]:
    """Arrays of `failures.npz`: clouds on the objects that are shown, and a detection."""
    arrays: dict[str, np.ndarray] = {"rigs": np.array(rigs), "objects": np.array(shown)}
    for place, number in enumerate(shown):
        row = objects[number]
        for rig in range(2):
            cloud = rng.normal([row["x"], row["y"], row["z"]], 0.5, (30, 3))
            arrays[f"points/{place}/{rig}"] = cloud.astype(np.float32)
            box = [row[k] for k in ("x", "y", "z", "length", "width", "height", "yaw")]
            arrays[f"detections/{place}/{rig}"] = np.array([[*box, 0.9]])
    return arrays
