"""A studio, its page, and a browser that looks at it."""

import pytest

from lidarplace.studio.rigs_file import read_rigs
from lidarplace.studio.studio import Studio
from tests.lidarplace.studio.rigs import ROI, log_of, written


@pytest.fixture
def studio(tmp_path):
    return Studio(read_rigs(written(tmp_path)), log_of([(8.0, 1.0), (-9.0, -2.0), (6.0, 5.0)]), ROI)


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
