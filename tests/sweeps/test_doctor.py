"""What sweeps.commands.doctor says where something is missing, and on this machine."""

import json
import subprocess
import sys
from base64 import b64encode
from collections import namedtuple
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from threading import Thread
from urllib.parse import quote

import pytest
import triton
from typer.testing import CliRunner

from sweeps.commands import doctor
from sweeps.commands.doctor import Finding
from sweeps.execution import checks
from sweeps.execution.checks import CheckResult
from tests.sweeps.toy import call

ROOT = Path(__file__).parents[2]
Usage = namedtuple("Usage", "total used free")


def test_this_machine(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("grid.yaml").write_text("ray: debug\ngrid: {placement: [line]}\n")
    done = CliRunner().invoke(doctor.app, ["grid.yaml", "--json"])
    found = {item["check"]: item for item in json.loads(done.stdout)}
    assert found["packages"]["state"] == "good"
    assert found["SUMO"]["found"].startswith("Eclipse SUMO")
    assert found["scenes"]["found"].startswith("1 trials")
    assert found["Ray"]["found"] == "not used: ray is debug"
    missing = any(item["state"] == "missing" for item in found.values())
    assert done.exit_code == missing
    assert sorted(p.name for p in tmp_path.iterdir()) == ["grid.yaml"], "it leaves nothing behind"


def test_a_cluster_that_is_not_there_is_one_line():
    found = checks.ray("127.0.0.1:1")
    assert found.state == "missing"
    assert found.found == "ray.address 127.0.0.1:1: cannot be reached: Connection refused"


def test_a_ray_that_hangs(monkeypatch):
    monkeypatch.setattr(checks, "_RAY_TASK", "import time; time.sleep(600)")
    monkeypatch.setattr(checks, "_RAY_S", 0.2)
    assert checks.ray("local").found == "no task ended within 0 s"


def test_a_missing_and_an_old_package(monkeypatch):
    def version(name):
        if name == "numba":
            raise PackageNotFoundError(name)
        return "1.0" if name == "numpy" else "999"

    monkeypatch.setattr(checks, "version", version)
    found = checks.packages(None, needed=True)
    assert found.state == "missing"
    assert "numba is missing" in found.found
    assert "numpy 1.0, needed >=2.0" in found.found
    assert "-m pip install" in found.remedy
    assert "'numba>=0.61'" in found.remedy
    assert checks.packages(None, needed=False).state == "optional", "nobody asked for it"


def test_without_a_gpu_it_names_the_build_for_the_cpu(monkeypatch):
    """Plain pip takes the build with CUDA."""

    def version(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(checks, "version", version)
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    monkeypatch.setattr("torch.version.cuda", "13.0")
    monkeypatch.setattr(checks, "has_card", lambda: False)
    for found in (checks.packages("training", needed=True), checks.gpu()):
        assert "uv pip install --torch-backend cpu 'lidarplace[all]'" in found.remedy
    monkeypatch.setattr("torch.version.cuda", None)
    assert not checks.gpu().remedy
    assert (checks.gpu().state, checks.gpu(needed=True).state) == ("optional", "missing")


def test_the_extra_of_a_package_counts(monkeypatch):
    lines = {
        "lidarplace": ["ray[client]>=2.40; extra == 'cluster'"],
        "ray": ["click", "grpcio; extra == 'client'"],
    }
    monkeypatch.setattr(checks, "requires", lines.get)
    monkeypatch.setattr(checks, "version", lambda name: "2.60")
    found = checks.packages("cluster", needed=True)
    assert found.found == "ray 2.60, grpcio 2.60"


def test_a_gpu_that_torch_was_not_built_for(monkeypatch):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    monkeypatch.setattr("torch.version.cuda", None)
    monkeypatch.setattr(checks, "has_card", lambda: True)
    found = checks.gpu()
    assert found.state == "weak"
    assert found.remedy == "make clean && make setup TORCH_BACKEND=auto"
    monkeypatch.setattr("torch.version.cuda", "13.0")
    monkeypatch.setattr("training.device.gpu_problem", lambda: "")
    assert checks.gpu(needed=True).remedy == "unset CUDA_VISIBLE_DEVICES"


def test_a_gpu_and_its_problem(monkeypatch):
    for name, value in {
        "is_available": True,
        "device_count": 2,
        "get_device_name": "NVIDIA H100",
        "mem_get_info": (75e9, 80e9),
    }.items():
        monkeypatch.setattr(f"torch.cuda.{name}", lambda *_, value=value: value)
    monkeypatch.setattr("training.device.has_card", lambda: True)
    monkeypatch.setattr(checks, "driver_version", lambda: "580.65.06")
    monkeypatch.setattr(checks, "version", lambda name: {}[name])  # of pytorch-triton, say
    found = checks.gpu(needed=True)
    assert found.state == "good"
    assert found.found.startswith("NVIDIA H100, NVIDIA H100; 75 of 80 GB free; driver 580.65.06, ")
    assert f", triton {triton.__version__}" in found.found
    monkeypatch.setattr("training.device.gpu_problem", lambda: "GPU: no driver")
    assert checks.gpu().found.startswith("GPU: no driver (torch ")
    assert (checks.gpu().state, checks.gpu(needed=True).state) == ("weak", "missing")


def test_make_clean_keeps_results():
    command = ["make", "--no-print-directory", "--dry-run", "clean"]
    assert subprocess.check_output(command, cwd=ROOT, text=True) == "rm -rf .venv build\n"


def test_a_machine_without_sumo(monkeypatch):
    def sumo_home():
        raise ImportError("simulated traffic needs it") from ImportError("No module named 'sumo'")

    monkeypatch.setattr("lidarplace.scenes.sumo.town.sumo_home", sumo_home)
    found = checks.sumo(needed=True)
    assert (found.state, found.found) == ("missing", "No module named 'sumo'")
    assert "eclipse-sumo>=1.20" in found.remedy
    assert checks.sumo(needed=False).state == "optional"

    def without_libraries():
        raise ImportError("libX11.so.6: cannot open shared object file: No such file or directory")

    monkeypatch.setattr("lidarplace.scenes.sumo.town.sumo_home", without_libraries)
    found = checks.sumo(needed=True)
    assert (found.state, found.remedy.split()[:2]) == ("missing", ["apt-get", "install"])
    assert "libx11-6" in found.remedy


@pytest.mark.parametrize(("free", "state"), [(5e8, "missing"), (5e9, "weak"), (5e11, "good")])
def test_a_disk(monkeypatch, tmp_path, free, state):
    monkeypatch.setattr("shutil.disk_usage", lambda path: Usage(1e12, 1e12 - free, free))
    found = checks.disk(tmp_path / "runs", "my grid.yaml")
    assert found.state == state
    clean = "lidarplace clean 'my grid.yaml', or another output in the file"
    assert found.remedy == ("" if state == "good" else clean)
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr("shutil.disk_usage", lambda path: Usage(6.4e7, 0, free / 100))
    assert checks.shared_memory().state == ("good" if state == "good" else "weak")


def test_a_folder_that_cannot_be_written(monkeypatch, tmp_path):
    found = checks.mlflow(f"sqlite:///{tmp_path}/runs/mlflow.db")
    assert found.state == "good"
    assert found.found.endswith("made at need")

    def refuse(dir):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    cannot = f"{tmp_path}/runs: cannot be written: Permission denied"
    found = checks.disk(tmp_path / "runs", "grid.yaml")
    assert (found.state, found.found) == ("missing", cannot)
    found = checks.mlflow(f"sqlite:///{tmp_path}/runs/mlflow.db")
    assert (found.state, found.found) == ("missing", cannot)


@pytest.mark.parametrize(
    ("place", "make", "checked"),
    [
        ("runs", Path.touch, ["disk: run folder", "disk: store", "MLflow"]),
        ("runs/grid", Path.touch, ["disk: run folder"]),
        ("runs/grid", lambda path: path.symlink_to("nowhere"), ["disk: run folder"]),
        ("runs/store", Path.touch, ["disk: store"]),
        ("runs/mlflow.db", Path.mkdir, ["MLflow"]),
    ],
)
def test_what_is_in_the_way_of_a_run(monkeypatch, tmp_path, place, make, checked):
    monkeypatch.chdir(tmp_path)
    Path("grid.yaml").write_text("ray: debug\ngrid: {placement: [line]}\n")
    Path(place).parent.mkdir(exist_ok=True)
    make(Path(place))
    found = doctor.find_all(doctor.machine_needs(Path("grid.yaml")))
    names = ("disk: run folder", "disk: store", "MLflow")
    assert [f.check for f in found if f.check in names and f.state == "missing"] == checked


@pytest.mark.parametrize(
    ("free", "state", "fitting"), [(1e9, "missing", 1), (9e9, "weak", 4), (99e9, "good", None)]
)
def test_memory(monkeypatch, free, state, fitting):
    monkeypatch.setattr(checks, "machine_memory", lambda: (int(1e11), int(free)))
    monkeypatch.setattr("os.cpu_count", lambda: 8)
    found = checks.memory()
    assert (found.state, found.remedy) == (
        state,
        f"--set ray.num_cpus={fitting}" if fitting else "",
    )


@pytest.mark.parametrize("password", ["s3s@me", "other"])
def test_a_tracking_server_behind_a_password(password):
    """The password of an address, and never in the answer."""
    wanted = f"Basic {b64encode(b'me:s3s@me').decode()}"

    class Guarded(BaseHTTPRequestHandler):
        def do_POST(self):
            self.rfile.read(int(self.headers["Content-Length"]))
            allowed = self.headers["Authorization"] == wanted
            self.send_response(200 if allowed else 401)
            self.end_headers()
            self.wfile.write(b"{}" if allowed else b"You are not authenticated.")

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Guarded) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        address = f"127.0.0.1:{server.server_port}"
        found = checks.mlflow(f"http://me:{quote(password)}@{address}/")
        server.shutdown()
    shown = f"http://me:***@{address}/"
    if password == "s3s@me":
        assert (found.state, found.found) == ("good", f"{shown} answers")
    else:
        assert found.state == "missing"
        assert found.found.startswith(f"{shown}: ")
        assert "401" in found.found
    for scheme in ("http", "postgresql"):
        gone = checks.mlflow(f"{scheme}://me:{quote(password)}@127.0.0.1:1")
        assert gone.state == "missing"
        assert "Connection refused" in gone.found
        assert not any(own in gone.found + gone.remedy for own in (password, quote(password)))
    wrong = checks.mlflow(f"http://me:{password}@:a port")
    assert wrong.state == "missing"
    assert password not in str(wrong)


def test_a_remote_store(monkeypatch):
    assert checks.remote_store("memory://bucket/store").state == "good"
    found = checks.remote_store("nonsense://bucket")
    assert (found.state, found.remedy) == ("missing", "correct store.url in the file")
    monkeypatch.setitem(sys.modules, "gcsfs", None)
    found = checks.remote_store("gs://bucket/store")
    assert found.state == "missing"
    assert found.remedy.endswith("-m pip install gcsfs")


def test_one_failing_check_does_not_stop_the_others(monkeypatch):
    def broken():
        raise OSError("no such thing")

    monkeypatch.setattr(checks, "memory", broken)
    monkeypatch.setattr(checks, "ray", lambda address: CheckResult("there"))
    found = {finding.check: finding for finding in doctor.find_all(doctor.MachineNeeds())}
    assert found["memory"].state == "missing"
    assert found["memory"].found == "OSError: no such thing"
    assert "MLflow" in found


def test_exit_code_and_remedies(monkeypatch):
    good = Finding("3.11", check="Python", needed_for="everything")
    weak = Finding("5 GB", "weak", "clean it", check="disk: output", needed_for="results")
    missing = Finding("none", "missing", "install 'it[all]'", check="SUMO", needed_for="traffic")
    shown = [good, weak]
    monkeypatch.setattr(doctor, "find_all", lambda asked: shown)
    done = call(doctor.app)
    assert "disk: output: clean it" in done.output
    assert done.output.endswith("All requirements are installed.\n")
    shown.append(missing)
    done = call(doctor.app, code=1)
    assert "SUMO: install 'it[all]'" in done.output
    found = json.loads(call(doctor.app, "--json", code=1).output)
    assert [own["check"] for own in found] == ["Python", "disk: output", "SUMO"]


def test_overrides(monkeypatch, tmp_path):
    config = tmp_path / "grid.yaml"
    config.write_text("grid: {placement: [line]}\n")
    asked = []
    monkeypatch.setattr(doctor, "find_all", lambda found: asked.append(found) or [])

    def called(*overrides):
        call(doctor.app, config, *overrides)
        return asked.pop()

    assert (called().ray, called().cleaned) == ("local", str(config))
    found = called("--set", "ray=10.0.0.1:6379", "--set", f"store={tmp_path}/other")
    assert found.ray == "10.0.0.1:6379"
    assert found.cleaned == f"{tmp_path}/other"
    found = called("--set", "store=s3://bucket/store")
    assert found.cleaned == found.store == "s3://bucket/store"
    assert doctor.scenes(config, ["grid.placement=[line, center]"]).found.startswith("2 trials")
    found = doctor.scenes(config, ["training.checkpoint=nothing.pt"])
    assert found.state == "missing"
    assert "nothing.pt" in found.found
