"""Whether `expected_ig` counts rays rather than what they cover, in one sentence."""

import pandas as pd

from lidarplace.pog.surrogates.evaluate import MOSTLY_LINEAR


def ray_counting_caution(share: float) -> str | None:
    """What to know about `expected_ig` of this `linear_share`; None if there is nothing to say."""
    if not share > MOSTLY_LINEAR:
        return None
    return (
        f"Expected IG counts rays here: it is {100 * share:.0f} % of what it were if every ray "
        "counted by itself, so a ray through voxels that others have seen is worth as much as one "
        "through new ones. More lidar.azimuth_steps (lidar.cloud_share thins the clouds alone), a "
        "greater surrogate.detection_probability or a coarser surrogate.resolution change that."
    )


def largest_linear_share(surrogates: pd.DataFrame) -> float:
    """Of `surrogates.parquet`; NaN if there is no `expected_ig`, and of older run folders."""
    if "linear_share" not in surrogates:
        return float("nan")
    return float(surrogates["linear_share"].max())
