"""The best weights of each detector of a sweep, as MLflow models."""

import json
import math
import re
import warnings
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

from lidarplace.base.metrics import HEADLINE_METRIC
from lidarplace.base.registry import PLUGINS
from lidarplace.files.atomic import sync
from lidarplace.logs.boxes import GEOMETRY
from sweeps.plan.trial import DetectorTrial
from sweeps.results.trial_results import metric_mean
from sweeps.store.open import AnyStore
from sweeps.store.whole import whole_folder
from sweeps.tasks.code_version import place_of
from tracking.mlflow.content import Model
from tracking.mlflow.log import SweepLog
from training import NETWORKS, network_of
from training.typical_objects import as_plain

_OF_PREDICTION = ("batch_size", "score_threshold", "nms_threshold")
_POINTS = {"frame": "long"} | dict.fromkeys(("x", "y", "z", "intensity"), "double")
_BOXES = {"frame": "long", "class": "string"} | dict.fromkeys((*GEOMETRY, "score"), "double")
_CODE = Path(__file__).with_name("detector_model.py")


def log_best_models(
    trials: Iterable[DetectorTrial], store: AnyStore, folder: Path, log: SweepLog
) -> None:
    """Log the trial of each detector with the highest 3D AP of the first class at KITTI's IoU.

    Args:
        folder: where models are made, DETECTOR/KEY of the trial; one that is there is not made
            again.
    """
    best: dict[str, tuple[float, DetectorTrial]] = {}
    for trial in trials:
        if trial.finetune is None:  # a command's model is its own
            continue
        point = trial.grid_point.point
        ap = metric_mean([trial], HEADLINE_METRIC, point.classes[0], store)
        if not math.isnan(ap) and ap > best.get(str(point.detector), (-1.0, trial))[0]:
            best[str(point.detector)] = ap, trial
    for detector, (ap, trial) in best.items():
        own = folder / detector / trial.key
        if not own.exists():
            save_model(trial, store, own)
        point = trial.grid_point.point
        about = {
            "placement": point.placement,
            "seed": point.seed,
            f"{HEADLINE_METRIC}.{point.classes[0]}": f"{ap:.2f}",
        }
        log.model(Model(re.sub(r"[/:.%\"']", "_", detector), trial.key, own, about))


def save_model(trial: DetectorTrial, store: AnyStore, path: Path) -> None:
    """Write a trained detector in MLflow's format, in one step: its weights and no pickled code."""
    from mlflow.models import ModelSignature
    from mlflow.pyfunc import save_model as save_pyfunc
    from mlflow.types import ColSpec, Schema

    with TemporaryDirectory() as temporary, whole_folder(path) as folder, warnings.catch_warnings():
        weights, about = _write_parts(trial, store, Path(temporary))
        network = NETWORKS.roots([network_of(trial.evaluate.params.detector)])
        plugins = {own: PLUGINS[own] for own in (root.partition(".")[0] for root in network)}
        folders = [own for own, installed in plugins.items() if installed is None]
        needed = ["lidarplace", "torch", *(own.name for own in plugins.values() if own)]
        signature = ModelSignature(
            Schema([ColSpec(kind, name) for name, kind in _POINTS.items()]),
            Schema([ColSpec(kind, name) for name, kind in _BOXES.items()]),
        )
        warnings.filterwarnings("ignore", ".*input example was not provided", UserWarning)
        save_pyfunc(
            folder,
            python_model=str(_CODE),
            artifacts={"weights": str(weights), "detector": str(about)},
            signature=signature,
            pip_requirements=[f"{name}=={version(name)}" for name in needed],
            code_paths=[str(place_of(name)) for name in folders] or None,
        )
        for file in folder.rglob("*"):
            sync(file)


def _write_parts(trial: DetectorTrial, store: AnyStore, folder: Path) -> tuple[Path, Path]:
    from training.checkpoints import write_tensors

    params = trial.evaluate.params
    state_dict, classes = store.read(trial.learns, lambda own: (own.state_dict, own.classes))
    about = {
        "detector": params.detector,
        "classes": classes,
        "point_range": params.point_range,
        "typical": as_plain(params.typical),
        "settings": params.training.model_dump(mode="json", include=set(_OF_PREDICTION)),
    }
    weights, settings = folder / "weights.pt", folder / "detector.json"
    write_tensors(weights, state_dict)
    settings.write_text(json.dumps(about, indent=1))
    return weights, settings
