"""Start Ray on this machine, or join a cluster: the key `ray` of a configuration."""

import importlib.util
import ipaddress
import logging
import os
import platform
import secrets
import socket
import subprocess
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any

from lidarplace.base.code_version import PACKAGES, place_of
from lidarplace.base.errors import InputError, at
from lidarplace.base.plugin_folders import PLUGINS
from lidarplace.command_line.signals import Terminated, signals_held, stopped_by_signals
from sweeps.configuration.sweep import RaySettings
from training.nvidia import device_of_networks

THREADS = {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment of a worker: one thread a task, as Ray runs as many tasks as there are CPUs."""

_ROOT = Path(__file__).parents[2]
_CONNECT_S = 5.0
_STATUS_S = 30.0
_NODES_S = 120.0  # a node unpacks the code and starts a process
_SOCKET = "ray/session_2026-01-01_00-00-00_000000_1234567/sockets/plasma_store.10"
_LONGEST_SOCKET = 103  # bytes, as on macOS; Linux takes 107
_DECISIVE = ("numpy", "numba", "pandas", "scipy", "torch")


class ClusterError(InputError):
    """A cluster cannot be joined; the message names what to mend."""


@contextmanager
def ray_session(settings: RaySettings) -> Iterator[ModuleType]:
    """Return Ray, initialised by `settings`, and shut it down at the end.

    Raises ConnectionError: Ray cannot be started here; ClusterError: the cluster cannot be joined,
    or one of its nodes cannot work for this driver."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    # Three tries to reach a `ray://` server take 15 s in place of 30.
    os.environ.setdefault("RAY_CLIENT_MAX_CONNECTION_TIMEOUT_S", f"{_CONNECT_S:.0f}")
    local = settings.address == "local"
    with set_variables(_alone() if local else {}):
        import ray

        try:
            with signals_held():
                if local:
                    _start(ray, settings)
                    _check_alone(ray)
                else:
                    _check_token_file()
                    with at(f"ray.address {settings.address}", ClusterError):
                        _join(ray, settings.address)
            with stopped_by_signals():  # Ray's core would print its stack
                yield ray
        except SystemExit:  # of the handler that Ray has for SIGTERM while it starts
            raise Terminated from None
        finally:
            ray.shutdown()


@cache
def _alone() -> dict[str, str]:
    """Return variables that restrict a local Ray to this machine and this user.

    They are set before it is imported. The first makes it take 127.0.0.1 for a node's address and
    listen there alone. The argument `_node_ip_address="127.0.0.1"` does not: Ray replaces it by an
    address that others can reach. The second keeps it from starting workers that tasks, which need
    other variables, could never use. A token Ray would write into the home folder, where every user
    of the machine can read it; it remembers the first one, so a process has one."""
    return {
        "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",
        "RAY_prestart_worker_first_driver": "0",
        "RAY_AUTH_TOKEN": os.environ.get("RAY_AUTH_TOKEN", secrets.token_hex(32)),
    }


@contextmanager
def set_variables(variables: Mapping[str, str]) -> Iterator[None]:
    """Set variables for the block alone: other Rays, such as a cluster's, need others."""
    before = {name: os.environ[name] for name in variables if name in os.environ}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name in variables:
            del os.environ[name]
        os.environ.update(before)


_QUIET = {"log_to_driver": False, "logging_level": "ERROR"}


def _start(ray: ModuleType, settings: RaySettings) -> None:
    counts: dict[str, Any] = {"num_cpus": settings.num_cpus, "num_gpus": _usable_gpus(settings)}
    worker = {"env_vars": THREADS | {"PYTHONPATH": _python_path()}}
    place = os.environ.get("RAY_TMPDIR") or os.environ.get("TMPDIR") or "/tmp"
    if len(os.fsencode(f"{place}/{_SOCKET}")) > _LONGEST_SOCKET:
        logging.getLogger(__name__).warning(
            "TMPDIR is too long for Ray's sockets, which are in /tmp/ray instead: %s", place
        )
        counts["_temp_dir"] = "/tmp/ray"
    try:
        ray.init(address="local", include_dashboard=False, runtime_env=worker, **counts, **_QUIET)
    except Exception as error:  # Ray raises no narrower one
        raise ConnectionError(f"Ray did not start: {_last_line(str(error))}") from error


def _usable_gpus(settings: RaySettings) -> int | None:
    """Return how many GPUs a local Ray has: all, or none if networks cannot use them.

    Raises InputError if the configuration asks for some in vain."""
    if settings.num_gpus == 0 or (device := device_of_networks()) == "cuda":
        return settings.num_gpus
    if settings.num_gpus:
        problem = "networks cannot use a GPU" if device == "cpu" else device
        fix = "ray.num_gpus=0 trains on the CPU"
        raise InputError(problem, key="ray.num_gpus", fix=fix)
    if device != "cpu":
        logging.getLogger(__name__).warning("%s; networks run on the CPU", device)
    return 0


def _check_alone(ray: ModuleType) -> None:
    """Warn if other machines can reach Ray, which other versions of it may allow."""
    address = ray.util.get_node_ip_address()
    if not ipaddress.ip_address(address).is_loopback:
        logging.getLogger(__name__).warning(
            "Ray listens at %s, not on this machine alone; its token keeps others out", address
        )


def _check_token_file() -> None:
    """Warn if other users can read the token of a cluster; Ray writes the file that way."""
    if "RAY_AUTH_TOKEN" in os.environ:
        return
    path = Path(os.environ.get("RAY_AUTH_TOKEN_PATH", Path.home() / ".ray" / "auth_token"))
    if path.is_file() and path.stat().st_mode & 0o077:
        logging.getLogger(__name__).warning(
            "%s: other users can read this token; chmod 600 keeps it to you", path
        )


def enter_folder(folder: str) -> None:
    """Change to the folder of the driver, for relative paths. Raises FileNotFoundError."""
    if not Path(folder).is_dir():
        raise FileNotFoundError(
            f"node {platform.node()} has no folder {folder}, in which the sweep was started"
        )
    os.chdir(folder)


def _join(ray: ModuleType, address: str) -> None:
    if address.startswith("ray://"):
        if importlib.util.find_spec("grpc") is None:
            raise InputError("needs grpcio", fix="pip install 'lidarplace[cluster]'")
        hint = (
            "Is it the port of the cluster's client server, does RAY_AUTH_TOKEN or "
            "RAY_AUTH_TOKEN_PATH name its token, and was the head started with "
            "GRPC_ENABLE_FORK_SUPPORT=0?"
        )
        _check_port(address.removeprefix("ray://"))
        # It logs the end of its channel as an error; a lost cluster is an exception of a call too.
        logging.getLogger("ray.util.client").setLevel(logging.CRITICAL)
    else:
        hint = "Did the cluster stop?"
        if address != "auto":
            _check_port(address)
        _check_head(address)
    try:
        with warnings.catch_warnings(action="ignore"):
            ray.init(address=address, runtime_env=_cluster_environment(), **_QUIET)
    except (ConnectionError, ray.exceptions.RayError) as error:
        raise InputError(f"Ray does not answer: {_last_line(str(error))}. {hint}") from None
    except RuntimeError as error:
        if "Version mismatch" not in str(error):
            raise
        raise InputError(" ".join(str(error).split())) from None
    try:
        _check_nodes(ray)
    except BaseException:
        ray.shutdown()
        raise


def _cluster_environment() -> dict[str, Any]:
    return {
        "py_modules": [str(_ROOT / package) for package in PACKAGES] + _plug_ins(),
        "excludes": ["__pycache__/"],
        "env_vars": THREADS,
    }


def _plug_ins() -> list[str]:
    """List the packages of plug-ins, and the metadata in which their entry points are."""
    places = [place_of(name) for name in PLUGINS if name not in PACKAGES]
    for name, installed in PLUGINS.items():
        files = installed.files or () if installed is not None and name not in PACKAGES else ()
        places += [Path(str(f.locate())).parent for f in files if f.name == "entry_points.txt"]
    return [str(place) for place in dict.fromkeys(places)]


def _python_path() -> str:
    folders = [str(_ROOT), *(str(Path(place).parent) for place in _plug_ins())]
    return os.pathsep.join(filter(None, dict.fromkeys([*folders, os.environ.get("PYTHONPATH")])))


def _check_port(address: str) -> None:
    """Check that a port can be reached; Ray itself would wait much longer."""
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host, int(port)), timeout=_CONNECT_S).close()
    except OSError as error:
        raise InputError(f"cannot be reached: {error.strerror or error}") from None


def _check_head(address: str) -> None:
    """Ask for the cluster's status in another process: Ray's driver would end or hang."""
    command = [sys.executable, "-m", "ray.scripts.scripts", "status", "--address", address]
    try:
        process = subprocess.run(command, capture_output=True, text=True, timeout=_STATUS_S)
    except subprocess.TimeoutExpired:
        raise InputError(f"does not answer within {_STATUS_S:.0f} s") from None
    if not process.returncode:
        return
    text = process.stdout + process.stderr
    if "InvalidAuthToken" in text or "AuthenticationError" in text:
        fix = (
            "set RAY_AUTH_MODE=token and RAY_AUTH_TOKEN or RAY_AUTH_TOKEN_PATH to that of its head"
        )
        raise InputError("the cluster refuses the token", fix=fix)
    raise InputError(f"is not the head of a Ray cluster: {_last_line(text)}")


def _check_nodes(ray: ModuleType) -> None:
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    look = ray.remote(num_cpus=0)(_look_at_node)
    alive = [node["NodeID"] for node in ray.nodes() if node["Alive"]]
    places = (NodeAffinitySchedulingStrategy(node, soft=False) for node in alive)
    looks = [look.options(scheduling_strategy=place).remote(os.getcwd()) for place in places]
    driver_versions = _versions()
    try:
        nodes = ray.get(looks, timeout=_NODES_S)
    except ray.exceptions.RayError as error:
        raise InputError(f"a node cannot work: {_last_line(str(error))}") from None
    for name, folder_is_there, versions in nodes:
        if not folder_is_there:
            problem = f"node {name} has no folder {os.getcwd()}"
            raise InputError(problem, fix="start the sweep in one that all nodes share")
        for package, installed in versions.items():
            if installed != (expected := driver_versions[package]):
                problem = f"node {name} has {package} {installed}, and this driver {expected}"
                raise InputError(f"{problem}; results would depend on the node")


def _look_at_node(folder: str) -> tuple[str, bool, dict[str, str]]:
    return platform.node(), Path(folder).is_dir(), _versions()


def _versions() -> dict[str, str]:
    """Return versions of the packages that decide results, without the build of torch."""
    return {name: version(name).partition("+")[0] for name in _DECISIVE}


def _last_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1].rstrip(".")[:200] if lines else "no message"
