"""Rigs from and to the files of other tools: nuScenes, URDF, ROS 2, CARLA, ASAM OSI."""
