"""A studio, its page, and a browser that looks at it."""

import pytest

from lidarplace.studio.log_frames import scene_of
from lidarplace.studio.rigs_file import read_rigs
from lidarplace.studio.studio import Studio
from tests.lidarplace.studio.rigs import ROI, log_of, written
from tests.sweeps.small_log import write_small_log


@pytest.fixture
def studio(tmp_path):
    return Studio(read_rigs(written(tmp_path)), log_of([(8.0, 1.0), (-9.0, -2.0), (6.0, 5.0)]), ROI)


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """The traffic of a small log in the current folder, as a configuration has it."""
    monkeypatch.chdir(tmp_path)
    write_small_log(tmp_path / "log")
    return scene_of(tmp_path / "log")


@pytest.fixture
def page(studio):
    from tests.lidarplace.studio.browsers import shown

    with shown(studio) as page:
        yield page


@pytest.fixture
def browser(page):
    from tests.lidarplace.studio.browsers import Browser, until

    browser = Browser(page.address)
    until(lambda: "overwrite" in browser.labels)
    yield browser
    browser.close()
