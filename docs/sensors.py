"""Writes docs/sensors.md from the catalogue of LiDARs: `python docs/sensors.py`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from lidarplace.commands.sensors import HEAD as COLUMNS
from lidarplace.commands.sensors import more, row
from lidarplace.rigs.catalogue.datasheet import catalogue

PAGE = Path(__file__).with_suffix(".md")

HEAD = """# LiDARs by name

`python docs/sensors.py` makes this page from the catalogue. The same in a terminal:

```sh
lidarplace sensors              # all LiDARs
lidarplace sensors vlp16 at128  # these, with all values and their sources
```

A configuration accepts a name wherever it accepts a LiDAR: for all mounts, as an axis of a grid,
among the models of a search, for one mount of a placement, for a CARLA collection. Other keys
override its values. `range_noise` and `drop_off` of the top-level `lidar` also hold for LiDARs that
are named elsewhere, unless they or their data sheets have them. Case, hyphens and blanks do not
matter: `VLP-16` is `vlp16`.

```yaml
lidar: {name: vlp16, cloud_share: 0.2}     # or, alone, lidar: vlp16
placements:
  mixed: {mounts: [{z: 2.0}, {x: 2.3, z: 0.6, lidar: at128}]}
grid:
  placement: [line, mixed]
  lidar.name: [vlp16, os1_128]             # or lidar: [vlp16, os1_128]
```

```yaml
search:
  models: {roof: {name: ot128, price: 7}, corner: bpearl}
```

In Python:

```python
from dataclasses import replace
from lidarplace import Lidar

lidar = replace(Lidar.named("vlp16"), range=60.0)
own = Lidar.even(beams=16, elevation_deg=(-25, 5), azimuth_steps=1800, azimuth_deg=(-60, 60))
```

## From a maker's file

```sh
lidarplace sensors import metadata.json                   # Ouster
lidarplace sensors import VLP16db.yaml --out lidar.yaml   # Velodyne, of ROS; .xml of VeloView
lidarplace sensors import angle_correction.csv --like xt32  # Hesai
```

It compares the unit with the nearest LiDAR of the catalogue and prints a `lidar:` block with its
elevations, azimuth offsets of beams (`azimuth_offsets_deg`, positive to the left), heights of
lasers and azimuth steps. Ranges come from the catalogue if the beams are those of an entry, or from
`--like`. Beams that start beside the axis start on it here; the command says by how much.
Each group of beams with an offset of its own is cast by itself, so clouds take longer; coverage by
cones is the same for a full turn.

## What the numbers mean

- Beams come from a table that the maker or a driver has published. Otherwise they are spread
  evenly, and `approximate` is set. All beams of a LiDAR fire at the same azimuths, 10 frames per
  second. Horizontal offsets between beams come from the maker's
  file of a unit (`lidarplace sensors import`), not from the catalogue; vertical ones are known for
  `hdl64e`.
- Values without a source are missing, a dash below: no noise and no minimum range are simulated
  then. Not all sources are data sheets; some are drivers, copies of manuals, shop pages and
  simulator models. The data sheet of the unit that you buy has precedence.
- `range_10` and `range_80` are the farthest returns of surfaces that face the LiDAR and reflect
  10 % and 80 %. For other surfaces the range is a power of the returned light (reflectivity times
  the cosine of incidence), up to `range`. If only `range_10` is known, it follows the inverse
  square law. Without it all surfaces return from up to `range`.
- These values and the minimum range apply to simulated clouds, and so to detectors, and to
  `expected_recall`, `log_cells`, `log_points`, `enough_points` and requirements. Surrogates of the
  POG (`expected_points`, `expected_ig` and those of coverage) use `range` only, because a voxel has
  no material; so do CARLA's own LiDARs.
- A LiDAR of known size hides what is behind it from the other LiDARs of a rig, even if it is dead:
  in clouds, `expected_recall`, constraints and requirements. It is an upright cylinder if length
  and width are equal, otherwise a box, with the sensor in its middle. Set `size_mm` for your own
  LiDARs; without it nothing is hidden.
- Ranges are for clear air; `weather` and `window` reduce them, see below.
- There is no LiDAR of 1,550 nm, because no beam table of one was found.

## A pattern that does not repeat

Livox's LiDARs have no rotating beams. Their rays are a table in the order of firing: a CSV file
with columns `azimuth_deg` and `elevation_deg`, or `Azimuth/deg` and `Zenith/deg` as in the files
`scan_mode` of [Livox's simulation](https://github.com/Livox-SDK/livox_laser_simulation).

```yaml
lidar: {pattern: mid360.csv, pattern_rays: 20000, range: 70, range_10: 40, range_80: 70}
```

`pattern_rays` is the number of rays per frame. In simulated clouds each LiDAR uses another part of
the table in every frame, drawn by the scene's seed, because real ones are not synchronized.
Surrogates, `expected_recall`, requirements and the share of rays on the body use the first frame of
the table. Exact coverage (`surrogate.method: cone`) follows the rays of a table one by one, like
`dda`. Coinciding rings, CARLA's LiDARs and its files do not support patterns. `mid70` below has the
rosette of two rotating prisms.

## Your own LiDAR, from its clouds

```sh
lidarplace sensors fit clouds/sweeps --like vlp16 --out lidar.yaml
```

The command prints the beams, elevations, laser offsets, azimuth steps, range noise and share of
returns of the clouds, compared with the catalogue, and writes them as `lidar`, to copy into a
configuration. Other values, such as the range, are those of the catalogue. Without `--like` it
compares with the nearest LiDAR.

- Clouds have a column `ring`, or the order of KITTI's files, in which ring follows ring. Without
  either, the pattern is unknown: an error. Formats: .bin, .pcd.bin, .pcd, .feather, .parquet, .npy.
  Up to ten sweeps of a folder are used.
- Clouds are in the frame of their LiDAR. For clouds in the vehicle's frame, `--rig` names the
  mounts (a YAML file, or a log with its rig), or `--mount` the pose of one LiDAR. `--origin` is the
  origin of that frame in ours, such as `-1.425 0 0.33` for files of Argoverse 2. `--out` is then a
  file of `mounts`. Rays that do not start near the LiDAR's origin are an error.
- `offsets_m` is the height of every laser above the sensor's origin, along its z axis. Rays start
  there in clouds, `expected_recall`, requirements, coverage and shares of rays on the body. Each
  block of equal offsets is cast separately. Sight lines of the near field start at the origin.
  CARLA's LiDARs have none: `offsets_m: null`.
- `hdl64e` has elevations and offsets of KITTI's unit. The command found them in three of its
  sweeps: 0.20 m for the upper 32 lasers and 0.12 m for the lower ones. Other units differ. Nominal
  elevations were off by 0.27 degrees in the median, 0.75 at most. `vlp32c` agrees with sweeps of
  Argoverse 2 to 0.001 degrees in the median, `hdl32e` with one of nuScenes to 0.013.
- The catalogue's azimuth steps are for 10 turns per second. A name may have another rate:
  `hdl32e@20hz` has half of them, as on the vehicles of nuScenes.

## A correction from real recordings

A LiDAR on a vehicle loses some of the returns of an ideal one: its own vehicle hides objects, and
glass and distant surfaces return little. A correction describes these losses by class, fitted to
the vehicle's recordings ([reality](reality.md)):

```yaml
lidar: {name: vlp32c, correction: our_car.yaml, unit: up_lidar}    # in sweeps, searches, rigs
```

```yaml
factor: {Car: 0.62, Truck: 0.7, other: 0.6}        # share of the rays on an object that return
distance: 75                                       # metres after which 1/e of them do
lidars:                                            # by the name of the LiDAR in the recorded rig
  up_lidar:
    azimuth_steps: 1808                            # overrides the model, like elevations_deg
    mask: {azimuth_deg: 90, shares: [0.1, 1, 1, 0.4]}   # from -180 degrees on, to the left
classes: [Truck]                                   # further classes of your logs
fitted: {routes: 4, tracks: 257}                   # any notes
```

- A ray on an object returns with probability `factor × exp(-range / distance) × mask`, at most 1; a
  ray on anything else with that of the mask. Missing values count as 1. `drop_off` applies in
  addition.
- Rows of a mask by elevation: `elevation_deg: [-5, 5]` are the angles between three rows of
  `shares`. Without `unit` only factor and distance apply.
- One random number per ray decides, so all placements lose the same rays. Clouds,
  `expected_recall`, `log_cells`, `log_points`, `enough_points` and the observed lengths lose rays
  this way. Except in clouds, the LiDARs of a rig share these numbers, so stacked ones together see
  slightly less than in clouds.
- Requirements use the expected points, and for a cell `1 - product of (1 - p)` over its rays.
- Coverage and the other surrogates of the POG ignore corrections. CARLA's LiDARs cannot have one.
- The content of the file is part of the keys of results, not its path.
- In Python: `Lidar.named("vlp32c").corrected(read_correction("our_car.yaml"), unit="up_lidar")`,
  from `lidarplace.configuration.correction`.

## Weather, and a soiled window

```yaml
weather: {visibility: 100, rain: 5}        # metres of fog, millimetres an hour; clear by default
lidar: {name: xt32m, window: 0.9}          # share of the light that the window lets pass, each way
grid:
  placement: [line, center]
  weather.visibility: [null, 400, 100]     # or weather: [{}, {visibility: 400}, {rain: 20}]
```

- The extinction of fog is Koschmieder's, 3.912 / visibility, with Kim's exponent for other
  wavelengths than green, which is 0 below 500 m. That of rain is for Marshall's and Palmer's drops,
  0.000365 rain^0.63 in 1/m. Both add up. `lidarplace/rigs/weather.py` has the sources.
- A surface returns if as much light comes back as at the end of its range in clear air. The light
  depends on reflectivity, the losses in air and window, and the loss by distance, from `range_10`
  and `range_80` or else by the inverse square law.
- Surrogates of the POG and the coverage of requirements ignore reflectivity and use a shorter
  `range`, from which as much light comes back as from `range` in clear air.
- In clouds, rays end early at drops near the sensor (`lidarplace/clouds/droplets.py`), and
  intensities fall. `expected_recall`, the other surrogates of objects and requirements model the
  loss of light, but not rays that end early.
- To test a requirement in fog, set `also_when: {weather: {visibility: 100}}`.

```python
from lidarplace import Lidar, Weather

dim = Lidar.named("xt32m").in_weather(Weather(visibility=100))
print(dim.extinction, dim.reach, dim.sight([0.1, 0.8]))  # 1/m, metres, of 10 % and 80 %
```

## All LiDARs

Angles in degrees, ranges in metres, at 10 frames per second.
"""


def page() -> str:
    """The page as it should be."""
    sheets = catalogue().values()
    return "\n".join([HEAD, *_table(map(row, sheets)), "", "## Sources", *_sources(), ""])


def _table(rows: Iterable[tuple[str, ...]]) -> Iterator[str]:
    yield f"| {' | '.join(COLUMNS)} |"
    yield f"|{'---|' * len(COLUMNS)}"
    for name, *cells in rows:
        yield f"| `{name}` | {' | '.join(cells)} |"


def _sources() -> Iterator[str]:
    for sheet in catalogue().values():
        yield f"\n**{sheet.maker} {sheet.model}** (`{sheet.name}`)\n"
        for line in more(sheet):
            title, _, url = line.strip().partition(": https://")
            yield f"- [{title}](https://{url})" if url else f"- {title}"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)
