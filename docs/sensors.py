"""Writes docs/sensors.md from the catalogue of LiDARs: `python docs/sensors.py`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from lidarplace.commands.sensors import HEAD as COLUMNS
from lidarplace.commands.sensors import more, row
from lidarplace.rigs.catalogue.datasheet import catalogue

PAGE = Path(__file__).with_suffix(".md")

HEAD = """# LiDARs by name

A page that is made from the catalogue (`python docs/sensors.py`). The same in a terminal:

```sh
lidarplace sensors              # all of them
lidarplace sensors vlp16 at128  # these, with what else is known and where it was read
```

In a configuration a name stands wherever a LiDAR does: for all mounts, as an axis of a grid,
among the models of a search, for one mount of a placement, for a CARLA collection. Other keys
beside it win. Case, hyphens and blanks do not matter: `VLP-16` is `vlp16`.

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

## What the numbers mean

- Beams are those of a table that the maker or a driver has published, or spread evenly: then
  `approximate` says so. All beams of a LiDAR fire at the same azimuths, 10 frames a second;
  horizontal offsets between beams are left out, vertical ones are known of `hdl64e`.
- What no source told is left out, and a dash below: no noise is simulated then, and no least
  range. Not all sources are data sheets: there are drivers, copies of manuals, pages of shops and
  models of simulators among them. The data sheet of the unit that you buy wins.
- `range_10` and `range_80` are the farthest returns of surfaces that face the LiDAR and reflect
  10 % and 80 %. Between and beyond, the range goes with a power of the light that comes back
  (reflectivity times the cosine of incidence), up to `range`; by the inverse square law where only
  `range_10` is known. Without it all surfaces return from up to `range`.
- This, and the least range, is in simulated clouds, and so in all that detectors learn from, and in
  `expected_recall`, `log_cells`, `log_points`, `enough_points` and requirements. Surrogates of the
  POG (`expected_points`, `expected_ig` and those of coverage) know `range` alone, since a voxel has
  no material; so do CARLA's own LiDARs.
- By its size a LiDAR hides what is behind it from the others of a rig, also when it is dead: in
  clouds, `expected_recall`, constraints and requirements. It is an upright cylinder where length
  and width are equal, else a box, with the sensor in its middle. `size_mm` says it of LiDARs of
  your own; without it nothing is hidden.
- A range is one of clear air; `weather` and `window` shorten it, see below.
- A LiDAR of 1,550 nm is not here: of none the beams were found.

## A pattern that does not repeat

Livox's LiDARs have no beams that turn. Their rays are a table in the order of firing: a CSV file
with columns `azimuth_deg` and `elevation_deg`, or `Azimuth/deg` and `Zenith/deg` as in the files
`scan_mode` of [Livox's simulation](https://github.com/Livox-SDK/livox_laser_simulation).

```yaml
lidar: {pattern: mid360.csv, pattern_rays: 20000, range: 70, range_10: 40, range_80: 70}
```

`pattern_rays` are those of a frame. In simulated clouds each LiDAR shows another part of the table
in every frame, drawn by the scene's seed, since real ones are not in step. All else takes the first
frame of the table: surrogates, `expected_recall`, requirements and the share of rays on the body.
Exact coverage (`surrogate.method: cone`) walks the rays of a table one by one, as `dda` does. Rings
that coincide, CARLA's LiDARs and its files know no patterns. `mid70` below has the rosette of two
turning prisms.

## Your own LiDAR, from its clouds

```sh
lidarplace sensors fit clouds/sweeps --like vlp16 --out lidar.yaml
```

prints the beams, elevations, laser offsets, azimuth steps, range noise and share of returns that
the clouds show, with those of the catalogue, and writes them as `lidar`, to copy into a
configuration. Other values, such as the range, stay the catalogue's; without `--like` the nearest
LiDAR is shown.

- Clouds have a column `ring`, or the order of KITTI's files, in which ring follows ring. Without
  either the pattern is unknown, and the command refuses. Formats: .bin, .pcd.bin, .pcd, .feather,
  .parquet, .npy. Up to ten sweeps of a folder are used.
- Clouds are in the frame of their LiDAR. For clouds in the vehicle's frame `--rig` names the
  mounts, a YAML file or a log that has its rig, and `--mount` the pose of one LiDAR; `--origin`
  is where that frame starts in ours, such as `-1.425 0 0.33` for files of Argoverse 2. `--out` is
  a file of `mounts` then. Rays that do not start near the LiDAR's origin are an error.
- `offsets_m` has the height of every laser above the sensor's origin, along its z axis: rays
  start there in clouds, `expected_recall`, requirements, coverage and shares of rays on the body.
  Each block of equal offsets is cast by itself. Sight lines of the near field start at the
  origin. CARLA's LiDARs have none: `offsets_m: null`.
- `hdl64e` has elevations and offsets of KITTI's unit. The command found them in three of its
  sweeps, 0.20 m for the upper 32 lasers and 0.12 m for the lower; other units differ. Nominal
  elevations were off by 0.27 degrees in the median, 0.75 at most. `vlp32c` agrees with sweeps of
  Argoverse 2 to 0.001 degrees in the median, `hdl32e` with one of nuScenes to 0.013.
- The steps of the catalogue are those of 10 turns a second. A name may have another rate:
  `hdl32e@20hz` has half of them, as on the vehicles of nuScenes.

## A correction from real recordings

What a model of rays returns, a LiDAR on a vehicle loses in part: its own vehicle stands in the way,
glass and far surfaces return little. A correction says how much, class by class, learnt from the
vehicle's recordings:

```yaml
lidar: {name: vlp32c, correction: our_car.yaml, unit: up_lidar}    # in sweeps, searches, rigs
```

```yaml
factor: {Car: 0.62, Pedestrian: 0.7, other: 0.6}   # share of the rays on an object that return
distance: 75                                       # metres after which 1/e of them do
lidars:                                            # by the name of the LiDAR in the recorded rig
  up_lidar:
    azimuth_steps: 1808                            # wins, as elevations_deg and offsets_m do
    mask: {azimuth_deg: 90, shares: [0.1, 1, 1, 0.4]}   # from -180 degrees on, to the left
fitted: {routes: 4, tracks: 257}                   # free facts
```

- A ray on an object returns with probability `factor × exp(-range / distance) × mask`, at most 1; a
  ray on anything else with that of the mask. What is left out is 1. `drop_off` is lost besides.
- Rows of a mask by elevation: `elevation_deg: [-5, 5]` are the angles between three rows of
  `shares`. Without `unit` factor and distance count alone.
- One random number of each ray decides, so all placements lose the same rays. Clouds,
  `expected_recall`, `log_cells`, `log_points`, `enough_points` and the lengths observed thin their
  rays by it. The LiDARs of a rig share these numbers in all but clouds, so stacked ones see a
  little less together than there.
- Requirements expect the points, and a cell with `1 - product of (1 - p)` over its rays.
- Coverage and the other surrogates of the POG know no corrections. CARLA's LiDARs cannot have one.
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
  wavelengths than green, which is 0 below 500 m; that of rain is of Marshall's and Palmer's drops,
  0.000365 rain^0.63 in 1/m. `lidarplace/rigs/weather.py` has the sources. Both add up.
- A surface returns if as much light comes back as at the end of its range in clear air:
  reflectivity, what air and window leave of it, and the loss by distance that `range_10` and
  `range_80` tell, the inverse square where they do not.
- Surrogates of the POG and the coverage of requirements, which know no reflectivity, get a shorter
  `range`: where as much light comes back as from `range` in clear air.
- In clouds, rays end early at drops near the sensor (`lidarplace/clouds/droplets.py`), and
  intensities fall. `expected_recall`, the other surrogates of objects and requirements know the
  light that is lost, not the rays that end early.
- A requirement that has to hold in fog, too, says `also_when: {weather: {visibility: 100}}`.

```python
from lidarplace import Lidar, Weather

dim = Lidar.named("xt32m").in_weather(Weather(visibility=100))
print(dim.extinction, dim.reach, dim.sight([0.1, 0.8]))  # 1/m, metres, of 10 % and 80 %
```

## All of them

Angles in degrees, ranges in metres, at 10 frames a second.
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
