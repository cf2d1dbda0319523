"""A driver whose cluster loses a node under load and gets a new one; prints what it saw as JSON.

Call: python lose_a_node.py FOLDER
"""

import json
import os
import signal
import sys
import time
from pathlib import Path

from ray.cluster_utils import Cluster

from lidarplace.files.atomic import replacing
from sweeps.configuration.sweep import RaySettings
from sweeps.execution.ray_cluster import enter_folder, ray_session


def hold(folder: str, name: str, release: list[str]) -> str:
    """Tell where this runs, and end when all files of `release` are there."""
    import ray

    enter_folder(folder)
    node = ray.get_runtime_context().get_node_id()
    with replacing(Path(name)) as note:
        note.write_text(json.dumps({"node": node, "pid": os.getpid()}))
    while not all(Path(file).exists() for file in release):
        time.sleep(0.05)
    return node


def main(folder: Path) -> None:
    small = {"object_store_memory": 100_000_000, "include_dashboard": False}
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, **small})
    doomed = cluster.add_node(num_cpus=1, **small)
    survivor = cluster.add_node(num_cpus=1, **small)
    try:
        with ray_session(RaySettings(address=cluster.address)) as ray:
            task = ray.remote(num_cpus=1, max_retries=3)(hold)
            tasks = [task.remote(str(folder), f"task {i}", ["killed"]) for i in range(4)]
            pids: dict[str, int] = {}
            while pids.keys() != {doomed.node_id, survivor.node_id}:
                time.sleep(0.05)
                notes = [json.loads(path.read_text()) for path in folder.glob("task *")]
                pids = {note["node"]: note["pid"] for note in notes}
            os.kill(pids[doomed.node_id], signal.SIGKILL)
            cluster.remove_node(doomed, allow_graceful=False)
            (folder / "killed").touch()
            finished = ray.get(tasks)
            added = cluster.add_node(num_cpus=1, **small)
            # Each ends when the other runs: that takes two nodes of one CPU.
            pair = ("left", "right"), ("right", "left")
            both = ray.get([task.remote(str(folder), own, [other]) for own, other in pair])
        nodes = {"survivor": survivor.node_id, "added": added.node_id}
        print(json.dumps(nodes | {"finished": finished, "both": both}))
    finally:
        cluster.shutdown()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
