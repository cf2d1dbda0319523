import pytest

from lidarplace import PAPER_PLACEMENTS
from training import nvidia


@pytest.fixture
def card(monkeypatch):
    """A machine with a card; a call sets the code by which another process tries it."""
    monkeypatch.setattr(nvidia, "has_card", lambda: True)

    def set_probe(code):
        monkeypatch.setattr(nvidia, "_PROBE", code)
        nvidia.device_of_networks.cache_clear()

    yield set_probe
    nvidia.device_of_networks.cache_clear()


@pytest.fixture
def two_peers(monkeypatch):
    """Of the paper's eight: each is judged, which takes a second."""
    peers = {name: PAPER_PLACEMENTS[name] for name in ("line", "center")}
    monkeypatch.setattr("sweeps.search.problem.problem.PAPER_PLACEMENTS", peers)
