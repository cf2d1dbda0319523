"""KITTI's object layout: `velodyne`, `label_2`, `calib` and `ImageSets`, read and written."""
