"""The page of the studio: in a browser, and by what its server is told."""

import math
import re
import time
from types import SimpleNamespace

import numpy as np
import pytest

from lidarplace import Mount, OccupancyGrid, evaluate
from lidarplace.studio.frame_view import RESTING_POINTS, FrameView
from lidarplace.studio.numbers import Numbers
from lidarplace.studio.page.drawing import Redraw
from lidarplace.studio.page.editing import dragged
from lidarplace.studio.page.tables import message, numbers_table
from lidarplace.studio.rig import POSE
from lidarplace.studio.rigs_file import read_rigs
from tests.lidarplace.studio.rigs import ROI, TEXT, studio_of
from tests.refused import refused

pytest.importorskip("viser")

from lidarplace.studio.page.other_rig import VIOLET
from lidarplace.studio.page.panel import NO_RIG, assign
from lidarplace.studio.page.rig_nodes import quaternion, rgb
from lidarplace.studio.page.scene import CAR
from tests.lidarplace.studio.browsers import GUARD_S, Browser, chromium, shown, until


def s_mig_of(studio):
    grid = OccupancyGrid.from_boxes(studio.log.boxes, ROI, "Car", frames=len(studio.log.frames))
    return f"{evaluate(grid, studio.placement).s_mig:,.2f}".replace("-", "−")


def test_a_person_types_undoes_saves_and_reloads(page):
    Image = pytest.importorskip("PIL.Image", reason="needs Pillow")
    studio = page.studio
    assign(page.panel.cloud, False)  # a browser without a GPU draws points for seconds
    with chromium("--use-gl=swiftshader", "--enable-unsafe-swiftshader") as (browser, expect):
        requests = []
        tab = browser.new_page(viewport={"width": 640, "height": 480})
        tab.set_default_timeout(1000 * GUARD_S)
        tab.on("request", lambda request: requests.append(request.url))
        # Five frames a second: each is drawn by the CPU.
        slow = "requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 200)"
        tab.add_init_script(slow)
        tab.goto(page.address)
        expect.set_options(timeout=1000 * GUARD_S)
        number = tab.locator("[data-exact=true] [data-row=s-mig] b")
        before = s_mig_of(studio)
        expect(number).to_have_text(before)

        field = tab.get_by_label("pitch, °")
        field.fill("14.5")
        expect(number).not_to_have_text(before)
        expect(number).to_have_text(s_mig_of(studio))
        assert studio.rig.pose(0)["pitch"] == 14.5

        tab.get_by_role("button", name="undo").click()
        expect(number).to_have_text(before)
        expect(field).to_have_value("0")
        tab.get_by_role("button", name="redo").click()
        expect(field).to_have_value("14.5")

        tab.get_by_role("tab", name="View").click()
        with tab.expect_download() as download:
            tab.get_by_role("button", name="save a picture").click()
        width, height = Image.open(download.value.path()).size
        assert 200 < width <= 640
        assert 200 < height <= 480

        tab.get_by_role("tab", name="File").click()
        tab.get_by_role("button", name="save", exact=True).click()
        expect(tab.get_by_text("exists; choose overwrite")).to_be_visible()
        assert read_rigs(studio.file.path).rigs == studio.file.rigs
        tab.get_by_role("button", name="overwrite").click()
        expect(tab.get_by_text("saved:")).to_be_visible()
        assert read_rigs(studio.file.path).rigs == studio.rigs

        tab.reload()
        expect(number).to_have_text(s_mig_of(studio))
        expect(field).to_have_value("14.5")

        for typed, read in (("1,0", 1.0), ("-0,5", -0.5), ("7", 7.0)):
            field.fill(typed)
            until(lambda read=read: studio.rig.pose(0)["pitch"] == read)
        field.press("End")
        field.press(",")
        expect(field).to_have_value("7.")
        field.fill("7,5")
        until(lambda: studio.rig.pose(0)["pitch"] == 7.5)
        for unclear in ("1,000.5", "1,2,3"):
            field.fill(unclear)
            expect(field).to_have_value("")
            assert field.get_attribute("placeholder") == f"{unclear}?"
        assert studio.rig.pose(0)["pitch"] == 7.5
    local = r"(https?|ws)://127\.0\.0\.1|blob:|data:"
    outside = [url for url in requests if not re.match(local, url)]
    assert not outside


def drag(page, phase, position=(0.1, 0.6, 1.8), wxyz=None):
    """Return what a browser sends when somebody pulls at the handle."""
    wxyz = quaternion(page.studio.rig.mounts[page.editing.chosen]) if wxyz is None else wxyz
    target = SimpleNamespace(position=np.array(position), wxyz=wxyz)
    with pytest.raises(StopIteration):
        page._pulled(SimpleNamespace(phase=phase, target=target)).send(None)


def test_a_drag_moves_what_was_dragged_in_one_step_and_above_the_ground_alone(page):
    before = page.studio.rig
    for x in (0.2, 0.31, 0.4004):
        drag(page, "update", (x, 0.6, 1.8))
    drag(page, "end")
    after = page.studio.rig
    assert after.pose(0) == before.pose(0) | {"x": 0.4}
    assert after.lidars[0].written == dict(before.lidars[0].written) | {"x": 0.4}
    assert page.studio.undo()
    assert page.studio.rig == before
    drag(page, "update", (0.1, 0.6, -1.0))
    assert page.studio.rig == before
    assert "z: expected at least 0, found -1.0" in page.panel.message.content
    turned = quaternion(Mount.degrees(roll=-3.04, pitch=8.27, yaw=100.02))
    drag(page, "update", wxyz=turned)
    drag(page, "end")
    pose = page.studio.rig.pose(0)
    assert (pose["pitch"], pose["yaw"]) == (8.3, 100.0)
    assert pose["roll"] == pytest.approx(-3.0)  # the file has radians
    assert "roll_deg" not in page.studio.rig.lidars[0].written
    while page.studio.rig.lidars:  # somebody else takes away what is dragged
        page.studio.remove(0)
    drag(page, "update", wxyz=turned)
    page.refresh()
    until(lambda: page.editing.chosen is None)


def test_a_drag_without_an_end_is_drawn_at_rest_and_kept_by_the_next_step(page):
    drag(page, "update", (0.5, 0.6, 1.8))
    numbers, displayed = page.panel.numbers, s_mig_of(page.studio)
    until(lambda: displayed in numbers.content and 'data-exact="true"' in numbers.content)
    page.studio.pose(0, z=1.9)
    page.studio.undo()
    assert page.studio.rig.pose(0)["x"] == 0.5


def test_ten_browsers_see_the_same_rig_and_half_of_them_leave_in_the_midst_of_a_pull(page):
    browsers = [Browser(page.address) for _ in range(10)]
    exact = 'data-exact="true"'

    def all_show(text, among):
        return all(any(text in one and exact in one for one in b.content.values()) for b in among)

    until(lambda: all_show(s_mig_of(page.studio), browsers))
    for n, browser in enumerate(browsers):
        browser.pull((0.2 + 0.05 * n, 0.6, 1.8))
        until(lambda x=round(0.2 + 0.05 * n, 3): page.studio.rig.pose(0)["x"] == x)
        if n % 2:
            browser.close()
    left = browsers[::2]
    until(lambda: all_show(s_mig_of(page.studio), left))
    left[0].type("pitch, °", 7.5)
    until(lambda: page.studio.rig.pose(0)["pitch"] == 7.5)
    until(lambda: all(b.values["pitch, °"] == 7.5 for b in left[1:]))
    until(lambda: all_show(s_mig_of(page.studio), left))
    page.studio.undo()
    assert page.studio.rig.pose(0)["x"] == 0.65  # where the last one has let go
    late = Browser(page.address)
    page.refresh()
    until(lambda: all_show(s_mig_of(page.studio), [late]))
    for browser in (*left, late):
        browser.close()


def test_every_button_does_what_it_says(page):
    studio = page.studio
    counts = {"duplicate": 3, "mirror": 4, "add": 5, "to zone": 5, "remove": 4}
    for kind, number in counts.items():
        page.editing.change(kind)
        assert len(studio.rig.lidars) == number
    studio.model(page.editing.one(), "pandar40p")
    assert studio.rig.lidars[page.editing.one()].model == "pandar40p"
    assign(page.panel.to_add, "bpearl")
    page.editing.change("add")
    models = [lidar.model for lidar in studio.rig.lidars]
    assert models.count("bpearl") == models.count("pandar40p") == 1
    page.editing.choose_rig("left handed")
    assert studio.rig.name == "left handed"
    page.panel.ground.value = "blind for a child"
    page.panel.object.value = "none"
    page.refresh()
    until(lambda: "blind-for-a-child" in page.panel.numbers.content)
    page.panel.ground.value = "sensors on an adult"
    page.refresh()
    until(lambda: "less-than-2-sensors-on-an-adult" in page.panel.numbers.content)
    page.panel.ground.value = "recall of a Car"
    page.refresh()
    until(lambda: "mean-recall-of-a-car-on-the-ground" in page.panel.numbers.content)


def test_a_lidar_that_breaks_a_constraint_is_marked_in_the_scene(browser):
    until(lambda: browser.texts.get("/lidars/0/name") == "1")
    browser.type("x, m", 3.0)  # outside of its zone
    until(lambda: browser.texts["/lidars/0/name"] == "1 ✗")
    assert browser.texts["/lidars/1/name"] == "2"
    browser.type("works", False)
    until(lambda: browser.texts["/lidars/0/name"] == "1 ✗ (dead)")


def test_what_is_typed_while_the_fields_are_drawn_is_not_lost(page, browser, monkeypatch):
    say = page._say

    def slow(*told):
        time.sleep(0.02)  # between the field and who reads it; a draw comes meanwhile
        say(*told)

    monkeypatch.setattr(page, "_say", slow)
    for works in (False, True, False, True, False):
        browser.type("works", works)
        until(lambda works=works: page.studio.rig.lidars[0].enabled == works)


def test_another_rig_stands_beside_in_one_colour_over_it_or_apart(page, browser, monkeypatch):
    studio, other_rig = page.studio, page._drawing.other_rig
    calls, cloud = [], FrameView.cloud

    def counted(view, placement, most):
        calls.append(placement)
        return cloud(view, placement, most)

    monkeypatch.setattr(FrameView, "cloud", counted)
    assert not other_rig._node.visible
    browser.type("also, in violet", "left handed")
    other = studio.placement_of(studio.rigs[1])
    until(lambda: other_rig._node.visible and other in calls)
    until(lambda: len(other_rig._nodes._cloud.points) > 1)
    points = cloud(studio.view, other, RESTING_POINTS).points
    assert other_rig._nodes._cloud.points == pytest.approx(points, abs=0.02)
    assert {tuple(colour) for colour in other_rig._nodes._cloud.colors} == {rgb(VIOLET)}
    assert (len(other_rig._nodes._lidars), other_rig._node.position.tolist()) == (1, [0, 0, 0])
    assert "/other_rig/lidars/0/name" not in browser.texts
    number = calls.count(other)
    drag(page, "update", (0.3, 0.6, 1.8))
    drag(page, "end")
    exact = [s_mig_of(studio), 'data-exact="true"']
    until(lambda: all(text in page.panel.numbers.content for text in exact))
    assert calls.count(other) == number  # it has not moved
    browser.type("apart", True)
    until(lambda: other_rig._node.position.tolist() == [0, 21, 0])  # as wide as the ROI, and 5 m
    until(lambda: browser.cameras and browser.cameras[-1] != CAR[0])
    assert other_rig._apart.visible
    studio.show_frame(2)
    page.refresh(resting=False)  # as when it is played
    until(lambda: other_rig._objects == (other, studio.view))
    browser.type("apart", False)
    until(lambda: not other_rig._apart.visible and browser.cameras[-1] == CAR[0])
    page.editing.choose_rig("left handed")
    page.refresh()
    until(lambda: not other_rig._node.visible and page.panel.other_rig.value == NO_RIG)
    assert set(page.panel.other_rig.options) == {NO_RIG, "roof"}


def test_what_a_requirement_lacks_is_told_and_painted_at_rest(tmp_path):
    needs = """
requirements:
  - {name: near, where: {distance: [0.2, 1]}, what: Pedestrian, at_least: {points: 900}, step: 1}
"""
    with shown(studio_of(tmp_path, TEXT + needs)) as page:
        assign(page.panel.ground, "near")
        page.refresh()
        until(lambda: "fails:-near" in page.panel.numbers.content)
        until(lambda: "short of 900; worst at x" in page.panel.violations.content)
        assert "<b>100.0</b>" in page.panel.numbers.content  # nowhere are so many


def test_a_page_writes_beside_its_file_alone(page):
    hidden = (".yaml", ".yml", "..yaml", ".a.yaml")
    elsewhere = ("../other.yaml", "/srv/other.yaml", "", "rigs.txt")
    for name in (*hidden, *elsewhere, "a\0.yaml", "a\nb.yaml", "a.yaml\n"):
        with refused(("", "file name", repr(name))):
            page.files.path_of(name)
    assert page.files.path_of("a.yml").name == "a.yml"
    assert page.files.sweep().startswith("lidarplace run ")
    with pytest.raises(FileExistsError):
        page.files.sweep()
    assert page.panel.overwrite.visible
    assert page.files.confirm().startswith("lidarplace run ")
    assert page.files.confirm() == ""


def test_what_fails_to_be_drawn_is_told_and_the_next_is_drawn():
    drawn, failed = [], []

    def draw(resting):
        drawn.append(resting)
        if len(drawn) == 1:
            raise ValueError("first")

    redraw = Redraw(draw, failed.append)
    redraw.ask(resting=False)
    until(lambda: len(drawn) == 2)  # at rest it is drawn again, unasked
    redraw.end()
    assert drawn == [False, True]
    assert [str(error) for error in failed] == ["first"]


def test_a_pull_leaves_what_was_not_touched():
    """Also where two triples of angles are the same rotation."""
    random = np.random.default_rng(0)
    for angles in random.uniform(-360, 360, (50, 3)).round(1).tolist():
        before = dict(zip(POSE, [0.1234567, 0.6, 1.8, *angles], strict=True))
        wxyz = quaternion(Mount.degrees(**before))
        assert dragged(before, np.array([0.1234567, 0.6, 1.8]), wxyz) == {}
        assert dragged(before, np.array([0.1234567, 0.6, 1.9004]), -wxyz) == {"z": 1.9}
        to = dict(zip(POSE, [0.1234567, 0.6, 1.8, 10.0, -20.0, 100.0], strict=True))
        mount = Mount.degrees(**to)
        pose = before | dragged(before, mount.position, quaternion(mount))
        assert Mount.degrees(**pose).rotation == pytest.approx(mount.rotation, abs=0.003)


def test_tables_escape_names_and_say_what_is_not_known():
    numbers = Numbers({"<b>": -2.0}, {"<b>": 2.0}, {"<b>": math.nan}, exact=False)
    text = numbers_table(numbers, numbers, {"<b>": 4.0}, [("Price", 3.0, None, "g")])
    assert "<b>&lt;" not in text
    assert "Expected recall &lt;b&gt;" in text
    assert "−2.00" in text
    assert ">50.00<" in text
    assert text.count("–") == 3  # recall, its change, and that of the price
    assert message("<i>") != message("i")
    assert "&lt;i&gt;" in message("<i>")
