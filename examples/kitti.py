# %% [markdown]
# # Which placement sees best, on a folder in KITTI's layout
#
# From `label_2` and `calib` to a decision: what is on the road, where objects are likely, how much
# of that each placement sees. No detector, no GPU.
#
# `# %%` begins a cell: VS Code and Spyder run them one by one, and
# `jupytext --to ipynb examples/kitti.py` makes a notebook. As a script:
# `python examples/kitti.py data/kitti`. Without data of your own, `lidarplace export`
# writes such a folder (docs/kitti.md).

# %%
import os
import sys
from collections import Counter
from pathlib import Path

import pandas as pd
import plotly.graph_objects as go

from lidarplace import PAPER_PLACEMENTS, OccupancyGrid, Roi, evaluate
from lidarplace.commands.describe import describe
from lidarplace.logs.box_log import write_box_log
from lidarplace.scenes.kitti.read import read_kitti

# In a notebook there are no arguments: KITTI names the folder then.
FOLDER = Path(sys.argv[1] if len(sys.argv) == 2 else os.environ.get("KITTI", "data/kitti"))
PLACEMENTS = ["line", "center", "pyramid"]

# %% [markdown]
# ## 1. A box log
# KITTI's labels are in the camera's frame; `read_kitti` moves them into the vehicle's: x forward,
# y left, z up, origin on the ground. Vans count as cars, trucks and cyclists are the paper's
# *Van and Cyclist*. What has no class is counted in `ignored`.

# %%
ignored: Counter[str] = Counter()
log = read_kitti(FOLDER, ignored=ignored)
write_box_log(Path("logs/kitti"), log)  # for `scene: {source: log, folder: logs/kitti}` of a sweep
print(f"{len(log.frames):,} frames, {len(log.boxes):,} boxes; left out: {dict(ignored)}")
print(describe(log).filter(regex="scene|split|frames|front").round(2).to_string(index=False))

# %% [markdown]
# ## 2. Where objects are likely
# The probabilistic occupancy grid (POG) has, for each voxel, the share of frames in which a car was
# there. KITTI labels what its forward camera shows, so the region of interest is ahead.

# %%
roi = Roi(x=(0, 40), y=(-20, 20), z=(0, 4), resolution=0.2)
grid = OccupancyGrid.from_boxes(log.boxes, roi, object_class="Car", frames=len(log.frames))
if not grid.probability.any():
    raise SystemExit(f"{FOLDER}: no car within {roi.x}, {roi.y}, {roi.z} m; widen the region")
print(f"{(grid.probability > 0).sum():,} of {grid.probability.size:,} voxels ever held a car")

# %% [markdown]
# ## 3. What each placement sees of it
# `covered_entropy` is the uncertainty within reach of some beam, and the negative of the paper's
# S-MIG. `expected_ig` is the information that beams are expected to gain if each detects what it
# crosses with a chance of 10 %. `expected_points` counts rays through voxels, by their probability.

# %%
NAMES = ["s_mig", "covered_entropy", "residual_entropy", "expected_points", "expected_ig"]
rows = []
for name in PLACEMENTS:
    result = evaluate(grid, PAPER_PLACEMENTS[name], surrogates=["expected_points", "expected_ig"])
    rows.append({"placement": name} | {key: getattr(result, key) for key in NAMES})
table = pd.DataFrame(rows).set_index("placement")
print(table.round(1).to_string())

# %% [markdown]
# ## 4. A picture
# What stays unseen, as a share of all uncertainty about cars: lower is better.

# %%
share = 100 * table["residual_entropy"] / (table["covered_entropy"] + table["residual_entropy"])
figure = go.Figure(go.Bar(x=share.index, y=share, marker_color="#0072B2"))
figure.update_layout(
    template="plotly_white",
    title="Uncertainty about cars that no beam reaches",
    xaxis_title="placement",
    yaxis_title="share of the POG's entropy (%)",
)
figure.write_html("kitti.html")
print("kitti.html")

# %% [markdown]
# ## 5. Which is best, and what that means
# If the three surrogates below name one placement, nothing here speaks against it. If they do not,
# the choice is between seeing more places (`covered_entropy`) and seeing them more often
# (`expected_points`), and which of these makes a detector better only a detector can tell:
# `lidarplace run` with `scene: {source: log, folder: logs/kitti}` trains some on this log.
#
# A caution: KITTI's frames are few places and one camera's view, and none of the surrogates knows
# what hides behind a car unless `occlusion=True`. Differences of a percent or two say little;
# the error and the sampling error in a sweep's report tell how little.

# %%
best = table[["covered_entropy", "expected_points", "expected_ig"]].idxmax()
for surrogate, name in best.items():
    others = table[surrogate].drop(name)
    lead = 100 * (table.loc[name, surrogate] / others.max() - 1)
    print(f"{surrogate}: {name}, {lead:.1f} % ahead of {others.idxmax()}")
print(
    f"all three: {best.iloc[0]}"
    if best.nunique() == 1
    else "they disagree: train detectors before you decide"
)
