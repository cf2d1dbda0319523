"""Jobs of a page: commands of a stand-in for `sweeps`, which runs as a process."""

import pytest

from lidarplace.studio.best_pose import BestPose

pytest.importorskip("viser")

from lidarplace.studio.page.jobs import LINES, NICENESS, Command
from lidarplace.studio.page.panel import assign
from tests.lidarplace.studio.browsers import until

RUN = r"""
import signal, sys, time
from pathlib import Path
signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
config = Path(sys.argv[1])
print("scene: 1 done", flush=True)
if Path("fails").exists():
    sys.exit("no frame is in the test split")
while Path("waits").exists():
    time.sleep(0.01)
tables = Path("runs", config.stem, "tables")
tables.mkdir(parents=True)
(tables / "best-recall-0.5-all.csv").write_text("placement,mean,low,high\nroof,61.2,55,67\n")
"""
MAIN = """
import runpy, sys
runpy.run_module(f"sweeps.{sys.argv.pop(1)}", run_name="__main__")
"""
FAILURES = """
import sys
from pathlib import Path
Path("asked").write_text(" ".join(sys.argv[1:]))
print("3 objects are found by roof alone")
"""
TALK = """
import os, sys
for number in range(20):
    print("line", number)
print("niceness", os.nice(0), file=sys.stderr)
sys.exit(3)
"""


def test_a_command_tells_what_it_prints_and_how_it_has_ended(tmp_path):
    (tmp_path / "talk.py").write_text(TALK)
    codes = []
    command = Command(["talk"], lambda own: codes.append(own.exit_code))
    assert command.wait() == 3
    assert len(command.lines) == LINES
    assert command.lines[0] == f"line {20 - LINES + 1}"
    assert command.lines[-1] == f"niceness {NICENESS}"
    assert len(codes) == 22  # after each line, and at the end
    assert codes[-1] == 3
    command.cancel()  # does no harm


@pytest.fixture(autouse=True)
def in_a_folder_in_which_run_is_a_stand_in(tmp_path, monkeypatch):
    (tmp_path / "sweeps").mkdir()
    (tmp_path / "sweeps/__init__.py").touch()
    (tmp_path / "sweeps/main.py").write_text(MAIN)
    (tmp_path / "sweeps/run.py").write_text(RUN)
    (tmp_path / "sweeps/failures.py").write_text(FAILURES)
    monkeypatch.chdir(tmp_path)


def test_an_evaluation_is_shown_with_its_intervals_and_two_rigs_compared(page, tmp_path):
    with pytest.raises(ValueError, match="evaluate the rigs first"):
        page.jobs.compare()
    page.jobs.evaluate()
    assert "<b>61.2</b> (55.0 to 67.0)" in page.panel.found.content
    assert "scene: 1 done" in page.panel.progress.content
    assert "runs/evaluation-of-rigs/decision.html" in page.panel.message.content
    assert not page.panel.cancel.visible
    assign(page.panel.compared[1], "left handed")
    page.jobs.compare()
    expected = (
        "runs/evaluation-of-rigs --rigs roof,left handed --out runs/evaluation-of-rigs/compared"
    )
    assert (tmp_path / "asked").read_text() == expected
    assert "found by roof alone" in page.panel.progress.content
    assign(page.panel.compared[1], "roof")
    with pytest.raises(ValueError, match="two different rigs"):
        page.jobs.compare()


def test_the_page_goes_on_while_something_runs_which_can_be_cancelled(page, browser, tmp_path):
    (tmp_path / "waits").touch()
    browser.type("evaluate all rigs", True)
    until(lambda: "scene: 1 done" in page.panel.progress.content)
    assert page.panel.cancel.visible
    with pytest.raises(ValueError, match="another job is running"):
        page.jobs.evaluate()
    browser.type("pitch, °", 3.0)
    until(lambda: page.studio.rig.pose(0)["pitch"] == 3.0)
    browser.type("cancel", True)
    until(lambda: "cancelled" in page.panel.message.content)
    assert not page.panel.cancel.visible
    (tmp_path / "waits").unlink()
    (tmp_path / "fails").touch()
    browser.type("evaluate all rigs", True)
    until(lambda: "no frame is in the test split" in page.panel.message.content)
    (tmp_path / "fails").unlink()
    (tmp_path / "waits").touch()
    browser.type("evaluate all rigs", True)
    until(lambda: page.panel.cancel.visible and "1 done" in page.panel.progress.content)
    page.jobs.close()  # as when the page is closed
    until(lambda: "cancelled" in page.panel.message.content)


def test_one_more_lidar_is_mounted_where_it_finds_most(page, monkeypatch):
    assign(page.panel.to_add, "vlp16")
    page.jobs.add_best()
    assert [lidar.model for lidar in page.studio.rig.lidars] == [None, None, "vlp16"]
    assert page.editing.chosen == 2
    assert "→" in page.panel.message.content
    page.jobs.improve()
    assert page.editing.chosen == 2
    old = page.studio.rig.mounts[0]
    for broken, text in (
        ((), "no better pose was found<"),
        (("a child ahead", "zone"), "no better pose was found that keeps a child ahead, zone<"),
    ):
        pose = BestPose(old, 0.5, 0.5, broken)
        monkeypatch.setattr(page.studio, "improve", lambda number, pose=pose: pose)
        page.jobs.improve()
        assert text in page.panel.message.content
