"""Tables of a sweep's run folder."""

import math

from lidarplace.base.metrics import METRICS
from tracking.run_folders.table_schema import Column, TableSchema

_EVERY_AXIS = ("",)
_SCENE_AXES = ("scene", "site", "roi")
_SURROGATE_AXES = (*_SCENE_AXES, "lidar", "vehicle", "weather", "surrogate")
_CLOUD_AXES = (*_SCENE_AXES, "lidar", "vehicle", "weather", "mounting_errors")

_TRIAL = Column("trial", "str", "key of the trial, as in `--dry-run` and MLflow")
PLACEMENT = Column("placement", "str", "its name")
_DETECTOR = Column("detector", "str", "its name; empty without one", unknown="")
_SEED = Column("seed", "int64", "seed of the training")
_CLASS = Column("class", "str", "object class")
_SURROGATE = Column("surrogate", "str", "its name in the configuration")
_OF_SURROGATE = (PLACEMENT, _CLASS, _SURROGATE)
_METHOD = Column("method", "str", "method of coverage or of rays: `cone`, `dda`, `bresenham`")
_PERCENT = Column("value", "float64", "percent", finite=True)
_FROM = Column("from_m", "float64", "inner bound of the ring around the vehicle, m")
_RING = (_FROM, Column("to_m", "float64", "outer bound, m"))
_METRICS = [f"`{name}`" for name in METRICS]
_OF_TRIAL = (
    _TRIAL,
    PLACEMENT,
    Column("detector", "str", "its name"),
    _SEED,
    Column("class", "str", "object class; `all` for the recall of all objects"),
    Column("metric", "str", " or ".join(_METRICS).replace(" or ", ", ", len(_METRICS) - 2)),
    Column("iou", "float64", "the least overlap of a detection that counts; 0: of no single one"),
)

RESULTS = TableSchema.of(
    "results",
    "an evaluation's metric of a class",
    *_OF_TRIAL,
    Column("difficulty", "str", "of the objects; `all` here"),
    _PERCENT,
    Column("ground_truths", "int64", "boxes of the ground truth that count"),
    needed=True,
    axes=_EVERY_AXIS,
    key=("placement", "detector", "seed", "class", "metric", "iou", "difficulty"),
)
SURROGATES = TableSchema.of(
    "surrogates",
    "a surrogate of a class",
    *_OF_SURROGATE,
    Column("value", "float64", "in the surrogate's unit", finite=True),
    Column("method", "str", f"{_METHOD.doc}; `raycast` at objects", needed=False),
    Column(
        "seconds",
        "float64",
        "duration for all surrogates of the placement from the POG, or from objects, s",
        needed=False,
    ),
    Column(
        "linear_share",
        "float64",
        "of `expected_ig`: its value over that with every ray counted by itself",
        needed=False,
    ),
    needed=True,
    axes=_SURROGATE_AXES,
    key=("placement", "class", "surrogate"),
)
TRIALS = TableSchema.of(
    "trials",
    "a trial, finished or not",
    *(_TRIAL, PLACEMENT, _DETECTOR, _SEED),
    Column("seconds", "float64", "of training and evaluation, else of the surrogates, s"),
    Column("status", "str", "`finished`, `failed` or `pruned`"),
    Column("error", "str", "why it failed or was pruned"),
    needed=True,
    axes=_EVERY_AXIS,
    key=("trial",),
)
CURVES = TableSchema.of(
    "curves",
    "a value of an epoch of a training",
    _TRIAL,
    Column("epoch", "int64", "from 1"),
    Column("metric", "str", "`loss` and its parts, `seconds`, …"),
    Column("value", "float64", "of the epoch"),
)
PR_CURVES = TableSchema.of(
    "pr_curves",
    "a point of the precision-recall curve of an AP",
    *_OF_TRIAL,
    *(Column(name, "float64", "percent") for name in ("recall", "precision")),
    axes=_EVERY_AXIS,
)
DISTANCE = TableSchema.of(
    "distance",
    "a metric of the objects in one ring around the vehicle",
    *(*_OF_TRIAL, *_RING, _PERCENT),
    Column("ground_truths", "int64", "boxes of the ground truth in the ring"),
    axes=_EVERY_AXIS,
)
SECTOR = TableSchema.of(
    "sector",
    "the recall of the objects in one sector around the vehicle",
    *_OF_TRIAL,
    Column("sector", "str", "`front`, `front left`, …, each of 45 degrees"),
    Column("from_deg", "float64", "its bound on the right, degrees from x to the left"),
    Column("to_deg", "float64", "its bound on the left"),
    _PERCENT,
    Column("ground_truths", "int64", "boxes of the ground truth in the sector"),
    axes=_EVERY_AXIS,
)
LEFT_OUT = TableSchema.of(
    "left_out",
    "a result without one route, one individual or half of the routes of the test frames",
    *_OF_TRIAL,
    Column("unit", "str", "`route`, `individual`, `half` or `nothing`"),
    Column("left_out", "str", "name of the unit; `0a` and `0b` are the halves of one split"),
    Column("ground_truths", "int64", "ground-truth boxes of the unit"),
    Column(
        "members",
        "float64",
        "units of equal size that the unit groups, (Σn)² / Σn²: 1 but for more than 100 units",
        needed=False,
        unknown=1.0,
    ),
    Column(
        "value",
        "float64",
        "percent, of the others; AP without a `route` or an `individual` is the area under "
        "precision over recall at every hit",
    ),
    axes=_EVERY_AXIS,
)
POINTS = TableSchema.of(
    "points",
    "points on the objects of a class in one ring of the test frames",
    *(PLACEMENT, _CLASS, *_RING),
    Column("objects", "int64", "in the ring"),
    *(Column(name, "float64", "points an object") for name in ("mean", "median")),
    Column("p10", "float64", "10 % quantile of the points per object"),
    Column("unseen", "float64", "share of the objects without a point"),
    axes=_CLOUD_AXES,
)
INDIVIDUALS = TableSchema.of(
    "individuals",
    "an object on one route of one split",
    Column("split", "str", "`train` or `test`"),
    *(Column(name, None, "as in the box log") for name in ("scene", "route")),
    _CLASS,
    Column("object_id", None, "as in the box log"),
    Column("boxes", "int64", "frames in which it counts"),
    axes=_SCENE_AXES,
)
OBJECTS = TableSchema.of(
    "objects",
    "an object in one test frame, of those that count",
    Column("object", "int64", "its number, from 0"),
    Column("scene", None, "as in the box log"),
    Column("frame", "int64", "as in the box log"),
    *(Column(name, None, "as in the box log") for name in ("route", "object_id")),
    _CLASS,
    *(Column(axis, "float64", "of the centre, ego frame, m") for axis in "xyz"),
    *(Column(side, "float64", "m") for side in ("length", "width", "height")),
    Column("yaw", "float64", "from the x axis to the left"),
    Column("visibility", "float64", "share that an ideal sensor above the middle sees, in [0, 1]"),
    Column("occluded", "int64", "KITTI's level of it: 0 fully visible, 1 partly, 2 largely"),
    axes=_SCENE_AXES,
)
FOUND = TableSchema.of(
    "found",
    "an object and a trial",
    _TRIAL,
    Column("object", "int64", "its number in `objects.parquet`"),
    Column("points", "int64", "points on it, if known", False, math.nan),
    Column("found", "bool", "whether `class_recall_3D` counts it at KITTI's strict IoU"),
)
ACCURACY = TableSchema.of(
    "accuracy",
    "a surrogate computed in one of several ways",
    *_OF_SURROGATE,
    _METHOD,
    Column("resolution", "float64", "edge of a voxel, m"),
    Column("azimuth_steps", "int64", "rays of a beam in a turn; 0 for cones"),
    Column("frames", "int64", "in the POG"),
    Column("value", "float64", "in the surrogate's unit", needed=False),
    Column("comparable", "float64", "in units that the resolution does not change"),
    Column("reference", "bool", "whether it is the most accurate setting"),
    Column("seconds", "float64", "of the evaluation, s"),
    Column("pog_seconds", "float64", "duration for the POG and its dependent values, s"),
    axes=_SURROGATE_AXES,
)
SAMPLING_ERROR = TableSchema.of(
    "sampling_error",
    "a surrogate's error by the choice of the frames",
    *_OF_SURROGATE,
    Column("value", "float64", "in the surrogate's unit"),
    Column("sd", "float64", "standard deviation of the resamples"),
    Column("bias", "float64", "their mean less the value"),
    *(Column(bound, "float64", "of the 95 % interval") for bound in ("low", "high")),
    Column("blocks", "int64", "of frames that were drawn", needed=False),
    Column("resamples", "int64", "how many there are", needed=False),
    axes=_SURROGATE_AXES,
    key=("placement", "class", "surrogate"),
)
POG_RESAMPLES = TableSchema.of(
    "pog_resamples",
    "a surrogate of one draw of the frames, the same for all placements",
    *_OF_SURROGATE,
    Column("resample", "int64", "from 0"),
    Column("value", "float64", "in the surrogate's unit"),
    axes=_SURROGATE_AXES,
    key=("placement", "class", "surrogate", "resample"),
)
REQUIREMENTS = TableSchema.of(
    "requirements",
    "a requirement under a placement in one case, as built first",
    PLACEMENT,
    Column("requirement", "str", "its name"),
    Column("measure", "str", "`points`, `cells`, …, and by how many sensors"),
    Column("at_least", "float64", "required value"),
    Column("for", "float64", "share of the area that needs it"),
    Column("case", "str", "`as built`, a dead LiDAR, a shorter range, weather, mounts off"),
    Column("met", "bool", "whether the rig surely passes in this case; it must in all"),
    Column("value", "float64", "value that this share of the area reaches"),
    Column("short_by", "float64", "missing part of `at_least`; 0 if it is met"),
    Column("enough", "float64", "share of the area that has enough"),
    Column(
        "undecided",
        "float64",
        "width of the interval of `enough` with `for` inside, or share by which `value` may be "
        "lower; 0: sure",
        needed=False,
        unknown=0.0,
    ),
    *(
        Column(axis, "float64", "worst position, m; missing for a common view", needed=False)
        for axis in "xy"
    ),
    Column(
        "heading_deg", "float64", "heading of the object there, degrees; missing for a coverage"
    ),
    Column("at_worst", "float64", "the worst value found"),
    axes=("scene", "site", "lidar", "vehicle", "weather", "surrogate"),
)
PROMOTIONS = TableSchema.of(
    "promotions",
    "a placement on a rung of `promote`",
    Column("rung", "int64", "from 0"),
    *(_DETECTOR, PLACEMENT),
    Column("by", "str", "the surrogate or metric that ranks"),
    Column("class", "str", "of that value; `all` for a sum over classes"),
    Column("value", "float64", "that it was ranked by"),
    Column("rank", "int64", "1 is best"),
    Column("kept", "bool", "whether it was kept"),
    Column("seconds", "float64", "of this rung alone, s"),
    Column("setting", "str", "what the rung's trainings change"),
)
TASKS = TableSchema.of(
    "tasks",
    "a task of the sweep that has a result",
    Column("stage", "str", "`scene`, `pog`, `surrogates`, …"),
    Column("label", "str", "its placement, detector, …"),
    Column("key", "str", "of its result in the store", needed=False),
    Column("seconds", "float64", "of work, s"),
    Column("cached", "bool", "whether the result was there before"),
    Column("started", "float64", "s after the start of the command", False, math.nan),
    Column("ended", "float64", "s after the start of the command", False, math.nan),
    Column("node", "str", "machine", False, ""),
    Column("peak_memory", "float64", "bytes", False, math.nan),
    Column("batch_size_reduced", "bool", "because of a GPU's memory", False, False),
)

TABLES: tuple[TableSchema, ...] = (RESULTS, SURROGATES, TRIALS, CURVES, PR_CURVES)
TABLES += (DISTANCE, SECTOR, LEFT_OUT, POINTS, INDIVIDUALS, ACCURACY, SAMPLING_ERROR, POG_RESAMPLES)
TABLES += (OBJECTS, FOUND, REQUIREMENTS, PROMOTIONS, TASKS)
"""All of them."""
