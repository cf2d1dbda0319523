"""Box logs of MAN TruckScenes, whose tables are those of nuScenes; a rig of six LiDARs.

https://github.com/TUMFTM/truckscenes-devkit has the schema. LiDARs are on the cabin, which moves on
its suspension, and on the chassis; the data set calibrates all in one frame, and so do we."""

from types import MappingProxyType

from lidarplace.base.class_names import IGNORE
from lidarplace.scenes.datasets.class_maps import NUSCENES, ClassMap
from lidarplace.scenes.datasets.nuscenes import Vehicle

ORIGIN = (3.6 / 2, 0.0, 0.0)
"""Our ego origin in theirs, metres. Poses have height 0, and the LiDAR on the front edge of the cab
is 5 m ahead, so theirs is taken to be on the ground under the rear axle; ours lies half a wheelbase
ahead. The data set names no wheelbase: that of a tractor of two axles is taken."""

CLASSES: ClassMap = MappingProxyType(
    {
        **NUSCENES,
        "static_object.traffic_sign": IGNORE,
        "vehicle.ego_trailer": IGNORE,
        "vehicle.other": IGNORE,
        "vehicle.train": IGNORE,
    }
)
"""Classes of the 27 categories. The vehicle's trailer is not an object around it."""

TRUCK = Vehicle("truckscenes", CLASSES, ORIGIN, poses_by_time=True)
