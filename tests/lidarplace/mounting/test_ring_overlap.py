"""Rings that coincide, against single rays and cases with known answers."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace import PAPER_PLACEMENTS, Lidar, Mount, Placement
from lidarplace.mounting.ring_overlap import AZIMUTHS, CELL_M, DISTANCES_M, TOP_M, rings

ONE = Lidar((math.radians(-5.0),), azimuth_steps=360)


def rig(*mounts, lidar=ONE):
    return Placement("rig", list(mounts), lidar)


def heights(mount, elevation, distance, azimuth):
    """Return where a level LiDAR's beam meets the strip, by trigonometry."""
    reach = math.hypot(
        distance * math.cos(azimuth) - mount.x, distance * math.sin(azimuth) - mount.y
    )
    return mount.z + reach * math.tan(elevation)


@settings(max_examples=50)
@given(
    st.floats(-1, 1), st.floats(-1, 1), st.floats(1, 3), st.lists(st.floats(-0.4, 0.1), max_size=8)
)
def test_level_lidars_against_trigonometry(x, y, z, elevations):
    lidar = Lidar((-0.1, *elevations), azimuth_steps=360)
    mount = Mount(x, y, z)
    strips = [(d, a, e) for d in DISTANCES_M for a in AZIMUTHS for e in lidar.elevations]
    met = {(d, a, e): heights(mount, e, d, a) for d, a, e in strips}
    cells = {(d, a, math.floor(up / CELL_M)) for (d, a, _), up in met.items() if 0 <= up < TOP_M}
    counts = rings(rig(mount, lidar=lidar))
    assert counts.hit == counts.all
    # Heights that are on a border but for rounding may be in either cell.
    near = sum(abs(heights(mount, e, d, a) / CELL_M % 1 - 0.5) > 0.5 - 1e-6 for d, a, e in strips)
    assert abs(counts.hit - len(cells)) <= near


def test_lidars_beside_each_other_waste_rings_and_stacked_ones_do_not():
    paper = Lidar.paper()
    side_by_side = rig(*(Mount(y=y, z=2.2) for y in (-1e-4, 0.0, 1e-4, 2e-4)), lidar=paper)
    assert rings(side_by_side).redundancy == pytest.approx(0.75, abs=0.01)
    order = {name: rings(placement).redundancy for name, placement in PAPER_PLACEMENTS.items()}
    assert max(order, key=order.__getitem__) == "line"
    assert min(order, key=order.__getitem__) == "center"


def test_a_quarter_of_a_beam_s_spacing_lays_rings_between_each_other():
    line = PAPER_PLACEMENTS["line"]
    pitches = np.radians([-0.75, -0.25, 0.25, 0.75])
    pitched = replace(
        line, mounts=[replace(m, pitch=p) for m, p in zip(line.mounts, pitches, strict=True)]
    )
    assert rings(pitched).redundancy < rings(line).redundancy / 2


def test_a_beam_at_the_border_of_two_cells_is_in_one():
    level = rig(Mount(z=20 * CELL_M), lidar=Lidar((0.0,), azimuth_steps=360))
    assert rings(level).all == len(DISTANCES_M) * len(AZIMUTHS)


def test_what_is_out_of_view_or_of_range_has_no_ring():
    behind = Lidar((-0.1,), 360, azimuth=(math.radians(90), math.radians(270)))
    assert rings(rig(Mount(z=2), lidar=behind)).all == 0
    assert rings(rig(Mount(z=2, yaw=math.pi), lidar=behind)).all > 0
    short = replace(ONE, range=5.0)
    assert rings(rig(Mount(z=2), lidar=short)).redundancy == 0
