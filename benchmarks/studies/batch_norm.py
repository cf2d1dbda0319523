"""Does a generalist judge better if its batch norm has the statistics of the rig in question?

Run as `python benchmarks/studies/batch_norm.py CONFIG OUT.csv --rigs A,B [--set KEY=VALUE]`, CONFIG
a sweep over judges generalist and specialist that has judged these rigs. For each rig the running
means and variances of the generalist are worked out anew from the rig's own training clouds,
without labels. OUT.csv gets AP and recall with and without it, beside those of the rig's own
detectors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import torch
import typer
from torch import Tensor, nn

from sweeps.plan.plan import read_plan
from sweeps.plan.trial import Trial
from sweeps.stages.collect import clouds_and_objects
from sweeps.store.local import Store
from sweeps.store.open import store_of
from training.detectors.build import build

BATCH = 4


def main(
    config: Path,
    out: Path,
    rigs: Annotated[str, typer.Option()],
    set_: Annotated[list[str] | None, typer.Option("--set")] = None,
) -> None:
    """A row a rig and metric; rigs that are there already are left out."""
    sweep, plan = read_plan(config, set_ or [])
    store = store_of(sweep)
    by_evaluator: dict[str, dict[str, list[Trial]]] = {}
    for trial in plan.trials:
        point = trial.grid_point.point
        by_evaluator.setdefault(point.evaluator, {}).setdefault(point.placement, []).append(trial)
    done = set(pd.read_csv(out)["placement"]) if out.exists() else set()
    for name in [name for name in rigs.split(",") if name not in done]:
        own = by_evaluator["specialist"][name]
        judge = by_evaluator["generalist"][name][0]
        found = {
            "own": pd.concat([_metrics(store, trial) for trial in own]),
            "as trained": _metrics(store, judge),
            "recalibrated": _recalibrated(store, judge, own[0]),
        }
        table = pd.DataFrame({key: _means(rows) for key, rows in found.items()}).reset_index()
        table = table.assign(placement=name).round(4)
        table.to_csv(out, mode="a", header=not out.exists(), index=False)
        print(name, flush=True)
    _summary(pd.read_csv(out))


def _summary(table: pd.DataFrame) -> None:
    """Rank correlation with the rigs' own detectors, and the mean difference to them."""
    kinds = ["as trained", "recalibrated"]
    for (name, metric, iou), own in table.groupby(["class", "metric", "iou"]):
        rho = own[kinds].corrwith(own["own"], method="spearman").round(2).to_dict()
        bias = own[kinds].sub(own["own"], axis=0).mean().round(1).to_dict()
        print(f"{name} {metric} @ {iou:g}: rho {rho}, bias {bias}")


def _metrics(store: Store, trial: Trial) -> pd.DataFrame:
    assert trial.evaluate is not None
    return store.load(trial.evaluate).metrics


def _means(rows: pd.DataFrame) -> pd.Series:
    keys = ["class", "metric", "iou"]
    return rows.groupby(keys, observed=True)["value"].mean()


def _recalibrated(store: Store, judge: Trial, own: Trial) -> pd.DataFrame:
    """Metrics of the generalist after its statistics were worked out anew."""
    assert judge.finetune is not None
    assert judge.evaluate is not None
    assert own.finetune is not None
    weights = store.load(judge.finetune)
    inputs = [store.load(task) for task in own.finetune.inputs]
    clouds, _ = clouds_and_objects(inputs)
    params = judge.evaluate.stage
    model = build(params.detector, weights.classes, point_range=params.point_range)
    model.load_state_dict(weights.state_dict)
    state = _statistics_of(model, clouds)
    tested = [store.load(task) for task in judge.evaluate.inputs if task is not judge.finetune]
    return params.run(replace(weights, state_dict=state), *tested).metrics


def _statistics_of(model: nn.Module, clouds: object) -> Mapping[str, Tensor]:
    """The weights with running statistics that are plain means over all batches."""
    model.eval()
    for module in model.modules():
        if isinstance(module, nn.modules.batchnorm._BatchNorm):
            module.reset_running_stats()
            module.momentum = None
            module.train()
    lift = np.array([0, 0, model.sensor_height, 0], np.float32)
    with torch.no_grad():
        for first in range(0, len(clouds), BATCH):
            batch = range(first, min(first + BATCH, len(clouds)))
            model.head_output([torch.from_numpy(clouds[i] - lift) for i in batch])
    return model.state_dict()


if __name__ == "__main__":
    typer.run(main)
