"""Access to the studio: pages of its own address, and nobody else."""

import socket
from http.client import HTTPConnection
from types import SimpleNamespace
from urllib.parse import urlsplit

import pytest
from typer.testing import CliRunner
from websockets.asyncio.server import serve
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from lidarplace.logs.box_log import write_box_log
from lidarplace.rigs.scan_timing import STILL_WORLD
from tests.lidarplace.studio.rigs import log_of, written
from tests.refused import refused

pytest.importorskip("viser")

import viser

from lidarplace.studio import command
from lidarplace.studio.page.server import serving

PROTOCOLS = [f"viser-v{viser.__version__}"]
EVIL = "http://evil.example"


@pytest.fixture(scope="module")
def address():
    with serving(None, "studio") as (_, address):
        yield address


def status(address, path, host="{host}", origin="http://{host}"):
    """Return how a websocket is answered; 101: it is open, and gets what the page shows."""
    netloc = urlsplit(address).netloc
    host = host.format(host=netloc)
    options = {"origin": origin and origin.format(host=host), "subprotocols": PROTOCOLS}
    wire = socket.create_connection(netloc.split(":"))
    try:
        with wire, connect(f"ws://{host}{path}", sock=wire, **options) as socket_:
            assert socket_.recv()
            return 101
    except InvalidStatus as error:
        return error.response.status_code


def test_a_websocket_needs_the_token_and_the_origin_of_the_page(address):
    path, port = urlsplit(address).path, urlsplit(address).port
    assert status(address, path) == status(address, f"{path}/?a=b") == 101
    for wrong in ("", "/", path[:-1], f"{path}a", f"/{path[:0:-1]}", f"{path}/a", "/%00", "/é"):
        assert status(address, wrong) == 403, wrong
    origins = (None, "null", EVIL, "http://localhost:{port}", "https://{host}", "http://{host}.a")
    for origin in (*origins, "http://127.0.0.1", "http://{host}/", "http://127.0.0.1:1"):
        origin = origin and origin.replace("{port}", str(port))
        assert status(address, path, origin=origin) == 403, origin
        assert status(address, "/", origin=origin) == 403, origin


def test_a_name_that_was_bound_to_this_machine_is_refused(address):
    path, port = urlsplit(address).path, urlsplit(address).port
    for host in ("evil.example", f"evil.example:{port}", f"127.0.0.1.evil.example:{port}"):
        assert status(address, path, host) == 403
    for host in (f"localhost:{port}", "localhost:9000"):  # a port that is forwarded
        assert status(address, path, host) == 101


def test_a_page_is_served_under_its_whole_address_alone(address):
    parts = urlsplit(address)
    for path, host, code in (
        (parts.path, parts.netloc, 200),
        (f"{parts.path}/?websocket=ws://{parts.netloc}", parts.netloc, 200),
        ("/", parts.netloc, 403),
        ("/index.html", parts.netloc, 403),
        (parts.path, "evil.example", 403),
        (f"{parts.path}/../../__init__.py", parts.netloc, 403),
    ):
        connection = HTTPConnection(parts.netloc)
        connection.request("GET", path, headers={"Host": host})
        assert connection.getresponse().status == code, path
        connection.close()


def test_every_session_has_a_port_and_a_token_of_its_own_and_no_public_address(address):
    with serving(None, "another") as (server, other):
        assert server.request_share_url() is None
        assert server.get_host() == "127.0.0.1"
        assert urlsplit(address).port != urlsplit(other).port
        token = urlsplit(other).path
        assert len(token) > 40
        assert status(other, token) == 101
        assert status(address, token) == 403


def test_a_port_in_use_is_one_line(address):
    port = urlsplit(address).port
    with refused(f"--port {port}: Address already in use"), serving(port, "studio"):
        pass


def test_a_viser_that_cannot_be_checked_does_not_serve(monkeypatch):
    """A viser that got hold of the listening call before."""
    listens = SimpleNamespace(asyncio=SimpleNamespace(server=SimpleNamespace(serve=serve)))
    monkeypatch.setattr(viser.infra._infra, "websockets", listens)
    with refused((f"viser {viser.__version__}", "", ""), "pip install"), serving(None, "one"):
        pass


@pytest.mark.parametrize("rate", [None, 10])
def test_the_command_warns_that_the_studio_ignores_the_time_of_a_turn(tmp_path, monkeypatch, rate):
    lidar = {"beams": 4, "azimuth_steps": 90, "rate_hz": rate}
    file = written(tmp_path, {"lidar": lidar, "placements": {"mine": {"mounts": [{"z": 2.0}]}}})
    write_box_log(tmp_path / "log", log_of([(8.0, 1.0)]))
    ended = SimpleNamespace(Event=lambda: SimpleNamespace(wait=lambda: None))
    monkeypatch.setattr(command, "threading", ended)
    result = CliRunner().invoke(command.app, [str(file), "--log", str(tmp_path / "log")])
    assert result.exit_code == 0, result.output
    assert (STILL_WORLD in result.stderr) == bool(rate)
