"""Draws what MLflow shows of a trial, each picture once."""

from pathlib import Path

from sweeps.plan.trial import DetectorTrial
from sweeps.store.open import AnyStore


def trial_pictures(trial: DetectorTrial, store: AnyStore, folder: Path) -> list[Path]:
    """PNGs of the placement, which trials share, and of precision over recall, if there is any.

    Args:
        folder: where they are; one that is there is not drawn again.
    """
    from tracking.mlflow.pictures import draw_pr_curves, draw_rig

    # Clouds differ where the rig or its vehicle does.
    placement = folder / trial.collect_test[0].key / "placement.png"
    curves = folder / trial.key / "precision_recall.png"
    if not placement.exists():
        rig = trial.surrogates.params.placement
        name = trial.grid_point.point.placement
        draw_rig(placement, name, rig.mounts, rig.lidars, trial.grid_point.vehicle)
    table = store.read(trial.evaluate, lambda found: found.pr_curves)
    if table.empty:  # no object of any class in the test frames
        return [placement]
    if not curves.exists():
        draw_pr_curves(curves, trial.label, table)
    return [placement, curves]
