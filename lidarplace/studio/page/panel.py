"""Fields of a page, and what they show of a studio."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from lidarplace.rigs.catalogue.datasheet import catalogue
from lidarplace.studio.blind_ground import COUNTED_M, FINDING, HEIGHTS_M
from lidarplace.studio.page.tables import left_out_message, message
from lidarplace.studio.rig import ANGLES, POSE
from lidarplace.studio.studio import Studio

if TYPE_CHECKING:
    import viser

NO_LIDAR = "none yet"
NO_COLOUR, NO_OBJECT, NO_RIG = "no colour", "none", "no rig"
FROM_FILE = "as the file says"

STEPS = dict.fromkeys(POSE[:3], 0.001) | dict.fromkeys(ANGLES, 0.1)
"""Steps of number fields and of the handle: metres and degrees."""
UNITS = dict.fromkeys(POSE[:3], "m") | dict.fromkeys(ANGLES, "°")
SHOWN_DIGITS = 4

DECIMAL_COMMA = """
addEventListener("input", event => {
  const field = event.target, typed = field.value;
  if (field.inputMode !== "decimal" || !typed.includes(",")) return;
  const point = typed.replace(",", "."), clear = point.search(/[.,].*[.,]/) < 0;
  const end = field.selectionStart;
  Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value")
    .set.call(field, clear ? point : "");
  field.setSelectionRange(end, end);
  field.placeholder = clear ? "" : typed + "?";
}, true)
"""
"""Script that reads 1,0 as 1.0, and empties a field of 1,000.5: the page's fields drop commas."""


class Panel:
    """Fields of a page on a server."""

    def __init__(self, server: viser.ViserServer, studio: Studio) -> None:
        from viser._messages import RunJavascriptMessage

        gui = server.gui
        names = [rig.name for rig in studio.rigs]
        self.rig = gui.add_dropdown("rig", names, initial_value=names[0])
        self.history = gui.add_button_group("history", ("undo", "redo"))
        self.numbers = gui.add_html("")
        self.violations = gui.add_html("")
        if studio.left_out:
            gui.add_html(message(left_out_message(studio)))
        tabs = gui.add_tab_group()
        with tabs.add_tab("LiDAR"):
            self.lidar = gui.add_dropdown("LiDAR", (NO_LIDAR,))
            steps = STEPS.items()
            self.pose = {n: gui.add_number(f"{n}, {UNITS[n]}", 0.0, step=step) for n, step in steps}
            models = (FROM_FILE, *catalogue())
            self.model = gui.add_dropdown("model", models)
            self.works = gui.add_checkbox("works", True)
            self.to_add = gui.add_dropdown("to add", models)
            changes = ("add", "duplicate", "mirror", "remove", "to zone")
            self.change = gui.add_button_group("change", changes)
            self.improve = gui.add_button("improve this LiDAR")
            self.add_best = gui.add_button("add one where it finds most")
        gui._websock_interface.queue_message(RunJavascriptMessage(DECIMAL_COMMA))
        with tabs.add_tab("View"):
            last = len(studio.frame_numbers) - 1
            self.frame = gui.add_slider("frame", 0, max(1, last), 1, 0, disabled=last == 0)
            self.play = gui.add_checkbox("play", False)
            self.cloud = gui.add_checkbox("points", True)
            self.other_rig = gui.add_dropdown("also, in violet", (NO_RIG,))
            self.apart = gui.add_checkbox("apart", False)
            required = (each.name for each in studio.file.settings.requirements)
            recall = [group for group, name in FINDING.items() if name in studio.classes]
            ground = (NO_COLOUR, *HEIGHTS_M, *COUNTED_M, *recall, *required)
            self.ground = gui.add_dropdown("ground", ground)
            self.unseen = gui.add_html("")
            self.object = gui.add_dropdown("why not seen", (NO_OBJECT,))
            self.answer = gui.add_html("")
            self.picture = gui.add_button("save a picture")
        with tabs.add_tab("Ask"):
            self.evaluate = gui.add_button("evaluate all rigs")
            self.cancel = gui.add_button("cancel", visible=False)
            self.progress = gui.add_html("")
            self.found = gui.add_html("")
            finds = gui.add_dropdown("what finds", names, initial_value=names[0])
            misses = gui.add_dropdown("and misses", names, initial_value=names[-1])
            self.compared = finds, misses
            self.compare = gui.add_button("compare these two")
        with tabs.add_tab("File"):
            self.new_rig = gui.add_text("new rig", "")
            self.copy = gui.add_button("copy this rig")
            self.path = gui.add_text("file", studio.file.path.name)
            self.save = gui.add_button("save")
            self.sweep_path = gui.add_text("sweep", f"sweep-of-{studio.file.path.name}")
            self.sweep = gui.add_button("sweep these rigs")
            self.overwrite = gui.add_button("overwrite", color="red", visible=False)
        self.message = gui.add_html("")

    def show(self, studio: Studio, chosen: int | None) -> None:
        """Bring the fields of rig and LiDAR up to date; what is right already stays."""
        rig, names = studio.rig, [rig.name for rig in studio.rigs]
        _choices(self.rig, names, rig.name)
        others = [name for name in names if name != rig.name]
        other = self.other_rig.value if self.other_rig.value in others else NO_RIG
        _choices(self.other_rig, [NO_RIG, *others], other)
        for compared in self.compared:
            _choices(compared, names, compared.value)
        labels = [
            f"{number}: {lidar.model or studio.file.settings.lidar.name or 'LiDAR'}"
            for number, lidar in enumerate(rig.lidars, 1)
        ] or [NO_LIDAR]
        _choices(self.lidar, labels, labels[chosen or 0])
        for field in (*self.pose.values(), self.model, self.works, self.improve):
            if field.disabled != (chosen is None):
                field.disabled = chosen is None
        if chosen is None:
            return
        for name, value in rig.pose(chosen).items():
            if round(self.pose[name].value, SHOWN_DIGITS) != round(value, SHOWN_DIGITS):
                assign(self.pose[name], round(value, SHOWN_DIGITS))
        assign(self.model, rig.lidars[chosen].model or FROM_FILE)
        assign(self.works, rig.lidars[chosen].enabled)

    def show_objects(self, ids: Sequence[str]) -> None:
        """List the objects of a frame."""
        chosen = self.object.value if self.object.value in ids else NO_OBJECT
        _choices(self.object, [NO_OBJECT, *ids], chosen)


def _choices(field: viser.GuiDropdownHandle[str], choices: Sequence[str], chosen: str) -> None:
    if tuple(choices) != field.options:
        field.options = tuple(choices)
    assign(field, chosen)


def assign(field: Any, value: object) -> None:
    """Set a field of the page; type checkers do not see the setter of its type."""
    field.value = value
