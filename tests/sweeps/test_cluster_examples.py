"""The files of examples/cluster are what Ray, KubeRay, Slurm's shell and Docker take."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

EXAMPLES = Path(__file__).parents[2] / "examples/cluster"
ROOT = EXAMPLES.parents[1]

# Keys of KubeRay's custom resources, ray.io/v1, as of its release 1.5.
CLUSTER = {
    *("authOptions", "autoscalerOptions", "enableInTreeAutoscaling"),
    *("gcsFaultToleranceOptions", "headGroupSpec", "headServiceAnnotations", "managedBy"),
    *("rayVersion", "suspend", "upgradeStrategy", "workerGroupSpecs"),
}
HEAD = {"enableIngress", "headService", "labels", "rayStartParams", "resources", "serviceType"}
HEAD |= {"template"}
WORKERS = {"groupName", "idleTimeoutSeconds", "labels", "maxReplicas", "minReplicas", "numOfHosts"}
WORKERS |= {"rayStartParams", "replicas", "resources", "scaleStrategy", "suspend", "template"}
JOB = {
    *("activeDeadlineSeconds", "backoffLimit", "clusterSelector", "deletionStrategy"),
    *("entrypoint", "entrypointNumCpus", "entrypointNumGpus", "entrypointResources"),
    *("jobId", "managedBy", "metadata", "rayClusterSpec", "runtimeEnvYAML"),
    *("shutdownAfterJobFinishes", "submissionMode", "submitterConfig"),
    *("submitterPodTemplate", "suspend", "ttlSecondsAfterFinished"),
}


def resources(name):
    """The Kubernetes objects of a file, by their kind."""
    found = yaml.safe_load_all((EXAMPLES / name).read_text())
    return {item["kind"]: item for item in found}


def pinned(package):
    return re.search(rf"^{package}==(.+)$", (ROOT / "constraints.txt").read_text(), re.M)[1]


def check_cluster(spec):
    assert set(spec) <= CLUSTER
    assert spec["rayVersion"] == pinned("ray")
    assert spec["authOptions"] == {"mode": "token"}
    assert set(spec["headGroupSpec"]) <= HEAD
    groups = [spec["headGroupSpec"], *spec["workerGroupSpecs"]]
    for group in spec["workerGroupSpecs"]:
        assert set(group) <= WORKERS
        assert group["minReplicas"] <= group["replicas"] <= group["maxReplicas"]
    for group in groups:
        assert all(isinstance(value, str) for value in group["rayStartParams"].values())
        pod = group["template"]["spec"]
        (container,) = pod["containers"]
        assert [mount["mountPath"] for mount in container["volumeMounts"]] == ["/sweeps"]
        named = {mount["name"] for mount in container["volumeMounts"]}
        assert named == {volume["name"] for volume in pod["volumes"]}
        assert container["resources"]["requests"] == container["resources"]["limits"]
    images = {g["template"]["spec"]["containers"][0]["image"] for g in groups}
    assert len(images) == 1, "all nodes have the same packages"


def test_kuberay_cluster():
    found = resources("kuberay-cluster.yaml")
    assert found["RayCluster"]["apiVersion"] == "ray.io/v1"
    check_cluster(found["RayCluster"]["spec"])
    assert found["PersistentVolumeClaim"]["spec"]["accessModes"] == ["ReadWriteMany"]


def test_kuberay_job():
    job = resources("kuberay-job.yaml")["RayJob"]
    assert job["apiVersion"] == "ray.io/v1"
    assert set(job["spec"]) <= JOB
    check_cluster(job["spec"]["rayClusterSpec"])
    assert "lidarplace run grid.yaml --set ray=auto" in job["spec"]["entrypoint"]


def test_machines_are_what_ray_up_takes():
    from ray.autoscaler._private.util import prepare_config, validate_config

    config = yaml.safe_load((EXAMPLES / "machines.yaml").read_text())
    prepared = prepare_config(config)
    validate_config(prepared)
    assert prepared["max_workers"] == len(config["provider"]["worker_ips"])
    for kind in ("head", "worker"):
        (start,) = (c for c in config[f"{kind}_start_ray_commands"] if " start " in c)
        assert "RAY_AUTH_MODE=token RAY_AUTH_TOKEN_PATH=/shared/sweeps/ray-token" in start


def options_of_ray(command):
    """The long options of `ray COMMAND`."""
    from ray.scripts.scripts import cli

    return {option for param in cli.commands[command].params for option in param.opts}


@pytest.mark.parametrize("name", ["slurm.sh", "machines.yaml"])
def test_options_of_ray_start(name):
    text = (EXAMPLES / name).read_text()
    of_srun = {"--overlap", "--nodes", "--ntasks", "--nodelist", "--exclude"}
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    used = set(re.findall(r"--[a-z][a-z-]+", "\n".join(lines)))
    used -= of_srun | {"--ip-address", "--delimiter", "--fields", "--set"}
    assert used
    assert used <= options_of_ray("start") | options_of_ray("status")


def test_the_script_for_slurm():
    script = EXAMPLES / "slurm.sh"
    subprocess.run(["bash", "-n", script], check=True)
    if shutil.which("shellcheck"):
        subprocess.run(["shellcheck", script], check=True)
