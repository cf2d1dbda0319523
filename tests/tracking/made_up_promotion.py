"""A made-up run folder of a sweep that promoted placements."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from tests.tracking.made_up_run import write_run

EPOCHS = "training.epochs"
SHORT, FULL = 2, 10
RUNGS = [
    {"by": "expected_ig", "class": "Car", "keep": 8, "set": {}},
    {"by": "AP_R40_3D", "class": "Car", "keep": 3, "set": {EPOCHS: SHORT}},
]


def write_promotion(
    path: Path,
    placements: int = 40,
    kept: tuple[int, int] = (8, 3),
    detectors: Sequence[str] = ("pointpillars_tiny",),
    **further: object,
) -> Path:
    """`placements` ranked by expected IG, kept[0] by a short training, kept[1] trained in full."""
    names = [f"p{i:02d}" for i in range(placements)]
    trainings = [(SHORT, 1.0), (FULL, 1.0)]
    write_run(path, names, trainings=trainings, detectors=detectors, **further)
    trials, results, surrogates, curves = (
        pd.read_parquet(path / f"{name}.parquet")
        for name in ("trials", "results", "surrogates", "curves")
    )
    car = surrogates.query("surrogate == 'expected_ig' and `class` == 'Car'")
    gain = car.set_index("placement")["value"].sort_values(ascending=False)
    short = results.query("`class` == 'Car' and metric == 'AP_R40_3D' and iou == 0.7")
    short = short[short[EPOCHS] == SHORT]
    rows = []
    for detector in detectors:
        second = gain.index[: kept[0]]
        own = short[(short["detector"] == detector) & short["placement"].isin(second)]
        ap = own.groupby("placement")["value"].mean().sort_values(ascending=False)
        for rung, values in enumerate((gain, ap)):
            for rank, (name, value) in enumerate(values.items(), start=1):
                seconds = 0.05
                if rung:
                    match = (trials["placement"] == name) & (trials["detector"] == detector)
                    seconds = trials.loc[match & (trials[EPOCHS] == SHORT), "seconds"].sum()
                    seconds *= SHORT / FULL
                own = {"rung": rung, "detector": detector, "placement": name, "class": "Car"}
                own |= {"by": RUNGS[rung]["by"], "value": value, "rank": rank, "seconds": seconds}
                own |= {"kept": rank <= kept[rung], "setting": f"{EPOCHS}={SHORT}" if rung else ""}
                rows.append(own)
        for epochs, reached in ((SHORT, set(second)), (FULL, set(ap.index[: kept[1]]))):
            pruned = (trials["detector"] == detector) & (trials[EPOCHS] == epochs)
            pruned &= ~trials["placement"].isin(reached)
            reason = f"{placements} by expected_ig (Car), {kept[0]} kept"
            trials.loc[pruned, ["status", "error"]] = "pruned", reason
            trials.loc[pruned, "seconds"] = np.nan
    trials["seconds"] *= trials[EPOCHS] / FULL
    gone = trials.loc[trials["status"] == "pruned", "trial"]
    tables = {"promotions": pd.DataFrame(rows), "trials": trials}
    tables["results"] = results[~results["trial"].isin(gone)]
    tables["curves"] = curves[~curves["trial"].isin(gone)]
    for name, table in tables.items():
        table.to_parquet(path / f"{name}.parquet", index=False)
    sweep = json.loads((path / "sweep.json").read_text())
    (path / "sweep.json").write_text(json.dumps(sweep | {"promote": RUNGS}))
    return path
