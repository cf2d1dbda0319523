"""The catalogue of LiDARs: whole, plausible, and what its sources say."""

import json
from urllib.parse import urlsplit

import numpy as np
import pytest
from typer.testing import CliRunner

from lidarplace import Lidar
from lidarplace.commands.sensors import app
from lidarplace.rigs.catalogue.datasheet import catalogue, datasheet

SHEETS = catalogue()


@pytest.mark.parametrize("name", SHEETS)
def test_each_is_a_plausible_lidar_and_has_a_source(name):
    sheet, lidar = SHEETS[name], Lidar.named(name)
    if sheet.rosette is None:
        np.testing.assert_allclose(np.degrees(lidar.elevations), sheet.elevations_deg, atol=1e-9)
    assert lidar.rays == sheet.rays
    assert lidar.full_turn == (sheet.azimuth_deg == (-180, 180) and sheet.rosette is None)
    assert lidar.range == sheet.range
    assert (lidar.min_range, lidar.range_noise) == (sheet.min_range or 0, sheet.range_noise or 0)
    for reflectivity, stated in ((0.1, sheet.range_10), (0.8, sheet.range_80)):
        if stated is not None:
            assert lidar.sight(reflectivity) == pytest.approx(stated, rel=1e-12)
    if sheet.rosette is None:
        assert (np.diff(sheet.elevations_deg) > 0).all()
        assert -90 <= sheet.elevations_deg[0] < sheet.elevations_deg[-1] <= 90
        assert 16 <= len(sheet.elevations_deg) <= 256
        assert 0 < sheet.azimuth_deg[1] - sheet.azimuth_deg[0] <= 360
        assert 500 <= sheet.azimuth_steps <= 4000
    else:
        assert 1000 <= sheet.rays <= 50_000
        assert 10 <= sheet.rosette.field_of_view_deg <= 120
    assert (sheet.min_range or 0) < 2 < (sheet.range_10 or sheet.range) <= sheet.range <= 500
    assert (sheet.range_10 or 0) <= (sheet.range_80 or sheet.range) <= sheet.range
    bounds = {
        "range_noise": (0.001, 0.1), "accuracy": (0.005, 0.1), "wavelength_nm": (840, 1560),
        "mass_kg": (0.1, 20), "power_w": (2, 70), "price_usd": (100, 100_000),
    }  # fmt: skip
    for key, (low, high) in bounds.items():
        assert low <= (getattr(sheet, key) or low) <= high, key
    assert all(20 <= side <= 300 for side in sheet.size_mm or ())
    assert sheet.sources
    for source in sheet.sources:
        assert source.title
        assert urlsplit(source.url).scheme == "https"
    if sheet.price_usd is not None:
        assert any("price" in source.title for source in sheet.sources)


# As the makers' data sheets and manuals state it for one return of each ray, at 10 Hz.
STATED = {
    "vlp16": 16e6 / 55.296,  # manual: 16 lasers every 55.296 microseconds
    "vlp32c": 32e6 / 55.296, "ruby_plus": 128e6 / 55.56, "vls128": 2_401_497.6,
    "os1_128": 2_621_440, "os1_64_gen1": 1_310_720, "at128": 1_536_000, "qt128": 1_152_000,
    "ot128": 3_456_000, "xt32": 640_000, "helios_16": 288_000, "helios_5515": 576_000,
    "bpearl": 576_000, "m1": 750_000,
}  # fmt: skip


@pytest.mark.parametrize("name", STATED)
def test_points_per_second(name):
    assert 10 * Lidar.named(name).rays == pytest.approx(STATED[name], rel=5e-4)


def test_beams_of_uneven_tables():
    # Of the manuals' tables: VLP-32C ends at 15 after 10.333 degrees and has 1/3 degree between
    # -4 and 1.667; the VLP-16's are odd; those of the Puck Hi-Res a third closer.
    ultra = SHEETS["vlp32c"].elevations_deg
    assert ultra[:3] == (-25, -15.639, -11.31)
    assert ultra[-2:] == (10.333, 15)
    dense = [e for e in ultra if -4 <= e <= 1.667]
    np.testing.assert_allclose(np.diff(dense), 1 / 3, atol=1e-3)
    assert len(dense) == 18
    odd, hires = np.arange(-15, 16, 2), SHEETS["puck_hires"].elevations_deg
    assert SHEETS["vlp16"].elevations_deg == tuple(odd)
    np.testing.assert_allclose(hires, odd * 2 / 3, atol=1e-3)


@pytest.mark.parametrize("written", ["vlp16", "VLP-16", "vlp_16", " Vlp 16 "])
def test_names_as_people_write_them(written):
    assert datasheet(written) is SHEETS["vlp16"]


def test_command():
    run = CliRunner().invoke
    listed = run(app, []).stdout
    assert all(name in listed for name in SHEETS)
    one = run(app, ["AT128"]).stdout
    assert "1,536,000" in one
    assert all(source.url in one for source in SHEETS["at128"].sources)
    found = json.loads(run(app, ["VLP-16", "bpearl", "--json"]).stdout)
    assert list(found) == ["vlp16", "bpearl"]
    assert found["vlp16"]["mass_kg"] == 0.83
    assert found["vlp16"]["range_10"] is None
    assert len(json.loads(run(app, ["--json"]).stdout)) == len(SHEETS)
