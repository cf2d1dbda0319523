"""A live scene is two files, as docs/extending.md has them."""

import yaml

from lidarplace.logs.box_log import read_box_log
from lidarplace.scenes.sumo.parts import town_parts
from lidarplace.scenes.sumo.settings import SumoScene
from sweeps.tasks.task import code_of
from tests.extending import blocks_of, check_layers, copy_tree, put, python

PLANNED = """
from pathlib import Path

from lidarplace.scenes.kinds import scene_parts
from lidarplace.scenes.sumo.settings import SumoScene
from sweeps.plan.plan import read_plan
from sweeps.tasks.task import code_of

_, plan = read_plan(Path("new.yaml"))
scenes = [task for task in plan.tasks if task.stage == "scene"]
print([task.label for task in scenes], len({task.key for task in scenes}))
town = scene_parts(SumoScene())[0].recording
print(code_of("scene", recording=town))
print(code_of("scene", recording=scenes[0].params.recording) != code_of("scene", recording=town))
"""


def test_a_live_scene_is_two_files(tmp_path):
    tree = copy_tree(tmp_path)
    scene, lines = blocks_of("A live scene")
    imported, row, kind = lines.split("\n\n")
    kinds = tree / "lidarplace/scenes/kinds.py"
    (tree / "lidarplace/scenes/platoon.py").write_text(scene, encoding="utf-8")
    put(kinds, "from lidarplace.scenes.recorded import", f"{imported}\n")
    put(kinds, '        "log": (LogScene', f"{row}\n")
    put(kinds, '    | Annotated[LogScene, Tag("log")]', kind)

    config = {
        "scene": {"source": "platoon", "frames": 20},
        "grid": {"placement": ["line", "center"], "scene.gap_m": [8.0, 12.0]},
        "ray": "debug",
    }
    (tree / "new.yaml").write_text(yaml.safe_dump(config))
    labels, town, another = python(tree, "-c", PLANNED).splitlines()
    assert labels == "['scene.gap_m=8.0', 'scene.gap_m=12.0'] 2"
    assert another == "True"
    # What the store has of other kinds of scenes stays.
    assert town == code_of("scene", recording=town_parts(SumoScene())[0].recording)

    python(tree, "-m", "sweeps.commands.record", "new.yaml", "logs")
    log = read_box_log(tree / "logs/scene.gap_m=8.0")
    assert log.frames["split"].value_counts().to_dict() == {"train": 18, "test": 2}
    assert set(log.boxes["x"]) == {8.0, 16.0, 24.0}

    wrong = ("-m", "sweeps.run", "new.yaml", "--dry-run", "--set", "scene.frames=9")
    told = python(tree, *wrong, code=2)
    assert "no frame is in the test split; frames is 9, allowed is at least 10" in told
    check_layers(tree)
