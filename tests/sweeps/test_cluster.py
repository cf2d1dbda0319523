"""Sweeps on clusters: nodes on this machine, which die and come, and which have no code."""

import ipaddress
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import psutil
import pytest

from lidarplace.base.code_version import PACKAGES
from sweeps.configuration.sweep import RaySettings
from sweeps.execution.ray_cluster import (
    ClusterError,
    _alone,
    _check_alone,
    _check_token_file,
    ray_session,
    set_variables,
)
from tests.forked import GUARD_S, free_port, run_forked
from tests.sweeps.small_log import SMALL, write_sweep

ROOT = Path(__file__).parents[2]


def environment(**more: str) -> dict[str, str]:
    """Of drivers and nodes; only they know the token."""
    return os.environ | {
        "RAY_AUTH_MODE": "token",
        "RAY_AUTH_TOKEN": secrets.token_hex(16),
        "RAY_USAGE_STATS_ENABLED": "0",
        # Five refused checks make a dead node; one that is only slow has ten seconds for each.
        "RAY_health_check_period_ms": "300",
        "OMP_NUM_THREADS": "1",
        "COLUMNS": "200",
        **more,
    }


DRIVER = """
import socket, sys
from lidarplace.command_line.signals import stopped_by_signals
from sweeps.configuration.sweep import RaySettings
from sweeps.execution.backends import backend_for

def hold(port):
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.recv(1)

try:
    with stopped_by_signals(), backend_for(RaySettings(address=sys.argv[1])) as backend:
        job = backend.submit(hold, int(sys.argv[2]))
        while True:
            backend.wait([job])
except KeyboardInterrupt:
    print("stopped")
"""


@contextmanager
def node(folder: Path, env: dict[str, str], *options: str) -> Iterator[None]:
    """A node by `ray start`, on which this project cannot be imported."""
    without = folder / "without"
    without.mkdir(exist_ok=True)
    for package in PACKAGES:
        (without / f"{package}.py").write_text(f"raise ImportError('{package} of this node')")
    env = env | {"PYTHONPATH": str(without), "GRPC_ENABLE_FORK_SUPPORT": "0"}
    # Nodes get the code without compiled kernels, and few rays are faster traced than compiled for.
    env |= {"NUMBA_DISABLE_JIT": "1"}
    start = [sys.executable, "-m", "ray.scripts.scripts", "start", "--block", "--num-cpus=1"]
    start += ["--object-store-memory=100000000", "--disable-usage-stats", *options]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    process = subprocess.Popen(start, cwd=folder, env=env, **pipes)
    try:
        said = []
        for line in process.stdout:
            said.append(line)
            if "runtime started" in line:
                break
        else:
            raise AssertionError("".join(said))
        yield
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=60)


@pytest.fixture(scope="module")
def head():
    """The head of a cluster: its folder, address, that of the client server, and the environment
    of drivers."""
    port, client, env = free_port(), free_port(), environment()
    options = ["--head", f"--port={port}", f"--ray-client-server-port={client}"]
    # Sockets need short paths.
    with tempfile.TemporaryDirectory(prefix="ray", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        options += ["--include-dashboard=false", f"--temp-dir={folder}/tmp"]
        with node(folder, env, *options):
            yield folder, f"127.0.0.1:{port}", f"ray://127.0.0.1:{client}", env


@pytest.fixture(scope="module")
def cluster(head):
    """A head and a worker node: as `head`, without the folder."""
    folder, address, *rest = head
    with node(folder, rest[-1], f"--address={address}"):
        yield address, *rest


@pytest.mark.parametrize(
    "kind",
    ["local", *(pytest.param(kind, marks=pytest.mark.long) for kind in ("host:port", "ray://"))],
)
def test_what_runs_ends_with_its_driver(request, tmp_path, kind):
    """And a local Ray listens on this machine alone and leaves no token."""
    address, env = kind, environment(HOME=str(tmp_path))
    if kind == "local":
        env = {name: value for name, value in env.items() if not name.startswith("RAY_AUTH")}
    else:
        host, client, env = request.getfixturevalue("cluster")
        address = client if kind == "ray://" else host
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(GUARD_S)
        driver = subprocess.Popen(
            [sys.executable, "-c", DRIVER, address, str(server.getsockname()[1])],
            cwd=tmp_path,
            env=env | {"PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        connection, _ = server.accept()
        with connection:
            connection.settimeout(GUARD_S)
            if kind == "local":
                check_alone(psutil.Process(driver.pid))
            driver.terminate()
            assert driver.communicate(timeout=GUARD_S) == ("stopped\n", "")
            assert driver.returncode == 0
            assert connection.recv(1) == b""
    assert not list(tmp_path.rglob("auth_token"))


def check_alone(root: psutil.Process) -> None:
    """Where a process and those below it listen only this machine can connect."""
    found: dict[str, set[str]] = {}
    for process in [root, *root.children(recursive=True)]:
        for own in process.net_connections("inet"):
            if own.status == psutil.CONN_LISTEN:
                found.setdefault(process.name(), set()).add(own.laddr.ip)
    assert {"gcs_server", "raylet"} <= found.keys()
    for name, addresses in found.items():
        for address in map(ipaddress.ip_address, addresses):
            mapped = getattr(address, "ipv4_mapped", None)
            assert (mapped or address).is_loopback, (name, address)


def sweep(
    folder: Path, address: str, env: dict[str, str], file: str = "small.yaml", **keys: object
) -> subprocess.CompletedProcess[str]:
    """A sweep of surrogates alone, or with `keys`, whose scene is a log at a relative path."""
    surrogate = SMALL["surrogate"] | {"resolution": 2.0, "names": ["ig"]}
    own = {"lidar": {"beams": 2, "azimuth_steps": 12}, "surrogate": surrogate, "detector": None}
    own |= {"grid": {"placement": ["line"]}, "ray": address}
    write_sweep(folder, file, **SMALL | own | keys)
    return run_forked(["run", file], folder, folder, env)


@pytest.mark.long
def test_a_sweep_by_the_client_of_nodes_that_have_not_its_code(cluster, tmp_path):
    _, address, env = cluster
    done = sweep(tmp_path, address, env)
    assert done.returncode == 0, done.stdout + done.stderr
    assert pd.read_parquet(tmp_path / "runs/small/surrogates.parquet")["value"].gt(0).all()


@pytest.mark.long
def test_a_network_next_to_its_configuration_on_nodes_that_have_no_code(cluster, tmp_path):
    address, _, env = cluster
    package = ROOT / "examples/own_detector/own_detector"
    shutil.copytree(package, tmp_path / "project/own_detector")
    keys = {"detector": "own_detector.nets:build", "training": {"epochs": 1}}
    done = sweep(tmp_path, address, env, "project/net.yaml", **keys)
    assert done.returncode == 0, done.stdout + done.stderr
    trials = pd.read_parquet(tmp_path / "runs/net/trials.parquet")
    assert trials["status"].tolist() == ["finished"]
    found = pd.read_parquet(tmp_path / "runs/net/surrogates.parquet")
    assert found["value"].gt(0).tolist() == [True]


def assert_refused(address, told):
    with (
        pytest.raises(ClusterError, match=told) as error,
        ray_session(RaySettings(address=address)),
    ):
        pytest.fail("it was joined")
    assert "\n" not in str(error.value)


def test_a_wrong_token_is_one_line(head, monkeypatch):
    _, address, _, env = head
    for name, value in (env | {"RAY_AUTH_TOKEN": secrets.token_hex(16)}).items():
        monkeypatch.setenv(name, value)
    assert_refused(address, "refuses the token")


@pytest.mark.parametrize("scheme", ["", "ray://"])
def test_a_cluster_that_is_not_there(scheme):
    address = f"{scheme}127.0.0.1:{free_port()}"
    assert_refused(address, f"ray.address {address}: cannot be reached")


def test_the_client_needs_grpc(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert_refused("ray://127.0.0.1:1", "needs grpcio")


class Ray:
    """A version that listens at another address."""

    class util:
        @staticmethod
        def get_node_ip_address():
            return "192.0.2.7"


def test_a_ray_that_listens_elsewhere_is_told(caplog):
    _check_alone(Ray)
    assert "192.0.2.7" in caplog.text
    assert len(caplog.records) == 1


def test_a_token_that_others_can_read_is_told(tmp_path, monkeypatch, caplog):
    path = tmp_path / "token"
    path.write_text("secret")
    path.chmod(0o644)
    monkeypatch.delenv("RAY_AUTH_TOKEN", raising=False)
    monkeypatch.setenv("RAY_AUTH_TOKEN_PATH", str(path))
    _check_token_file()
    assert str(path) in caplog.text
    assert "secret" not in caplog.text
    caplog.clear()
    path.chmod(0o600)
    _check_token_file()
    path.chmod(0o644)
    monkeypatch.setenv("RAY_AUTH_TOKEN", "given")  # which Ray prefers
    _check_token_file()
    assert not caplog.text


def test_what_a_local_ray_is_told_others_are_not(monkeypatch):
    monkeypatch.setenv("RAY_AUTH_TOKEN", "of a cluster")
    monkeypatch.delenv("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", raising=False)
    with set_variables({**_alone(), "RAY_AUTH_TOKEN": "own"}):
        assert os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] == "0"
        assert os.environ["RAY_AUTH_TOKEN"] == "own"
    assert os.environ["RAY_AUTH_TOKEN"] == "of a cluster"
    assert "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER" not in os.environ
