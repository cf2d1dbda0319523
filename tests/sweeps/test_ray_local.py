"""Ray on this machine alone: where it listens, and who can read its token."""

import ipaddress
import os
import subprocess
import sys
from pathlib import Path

import psutil

from sweeps.execution.ray_cluster import _alone, _check_alone, _check_token_file, _environment

ROOT = Path(__file__).parents[2]
DRIVER = """
import sys
from sweeps.configuration.sweep import RaySettings
from sweeps.execution.ray_cluster import ray_session
with ray_session(RaySettings(num_cpus=1)) as ray:
    print(ray.get(ray.remote(lambda: "works").remote()), flush=True)
    sys.stdin.readline()
"""


def listening(root: psutil.Process) -> dict[str, list[str]]:
    """Addresses at which a process and those below it listen, by name of the process."""
    found: dict[str, list[str]] = {}
    for process in [root, *root.children(recursive=True)]:
        for socket in process.net_connections("inet"):
            if socket.status == psutil.CONN_LISTEN:
                found.setdefault(process.name(), []).append(socket.laddr.ip)
    return found


def test_a_local_ray_listens_on_this_machine_alone_and_leaves_no_token(tmp_path):
    hidden = ("RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH")
    env = {name: value for name, value in os.environ.items() if name not in hidden}
    with subprocess.Popen(
        [sys.executable, "-c", DRIVER],
        cwd=tmp_path,
        env=env | {"PYTHONPATH": str(ROOT), "HOME": str(tmp_path)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as driver:
        assert driver.stdout.readline() == "works\n"
        found = listening(psutil.Process(driver.pid))
        driver.communicate("end\n")
    assert {"gcs_server", "raylet"} <= found.keys()
    for name, addresses in found.items():
        for text in addresses:
            address = ipaddress.ip_address(text)
            mapped = getattr(address, "ipv4_mapped", None)
            assert (mapped or address).is_loopback, (name, text)
    assert not list(tmp_path.rglob("auth_token"))


class Ray:
    """A version that takes another address."""

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
    with _environment({**_alone(), "RAY_AUTH_TOKEN": "own"}):
        assert os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] == "0"
        assert os.environ["RAY_AUTH_TOKEN"] == "own"
    assert os.environ["RAY_AUTH_TOKEN"] == "of a cluster"
    assert "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER" not in os.environ
