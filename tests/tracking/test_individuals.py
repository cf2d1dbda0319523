"""Individuals beside boxes: the count, the report's section, and its caution."""

from dataclasses import replace

import pandas as pd
import pytest

from tracking.individuals import count_individuals
from tracking.report.build import build_report
from tracking.report.cautions import FEW_INDIVIDUALS, cautions
from tracking.run_folder import RunFolder
from tracking.summary import seed_means


def rows(*objects):
    """A table of test objects: scene, route, class, object_id, boxes."""
    columns = ["scene", "route", "class", "object_id", "boxes"]
    return pd.DataFrame(objects, columns=columns).assign(split="test")


def test_a_car_of_two_routes_is_one_and_equal_names_of_two_scenes_are_two():
    table = rows(
        ("a", 0, "Car", "1", 30),
        ("a", 1, "Car", "1", 20),
        ("b", 2, "Car", "1", 5),
        ("b", 2, "Pedestrian", "9", 7),
    )
    car, pedestrian = count_individuals(table).to_dict("records")
    assert car == {
        "split": "test",
        "class": "Car",
        "routes": 3,
        "boxes": 55,
        "individuals": 2,
        "share_of_ten": 1.0,
    }
    assert (pedestrian["boxes"], pedestrian["individuals"], pedestrian["routes"]) == (7, 1, 1)


def test_the_share_of_the_ten_is_of_the_boxes():
    table = rows(*(("a", 0, "Car", str(i), 50 if i in (3, 30) else 1) for i in range(40)))
    (row,) = count_individuals(table).to_dict("records")
    assert row["share_of_ten"] == (2 * 50 + 8) / (2 * 50 + 38)
    assert count_individuals(table[:0]).empty


def test_the_report_has_them_beside_the_boxes(tmp_path, made_up_run):
    folder = tmp_path / "copy"
    folder.mkdir()
    for file in made_up_run.iterdir():
        if file.is_file():
            (folder / file.name).write_bytes(file.read_bytes())
    build_report(folder)
    table = pd.read_csv(folder / "tables" / "individuals.csv")
    table = table.set_index(["split", "class"])
    assert list(table.loc[("test", "Car"), ["routes", "boxes", "individuals"]]) == [4, 420, 34]
    assert table.loc[("test", "Car"), "share_of_ten"] == pytest.approx(300 / 420)
    text = (folder / "report.md").read_text(encoding="utf-8")
    assert "test frames with 840 boxes of 68 individuals" in text
    assert "Car: 420 test boxes are 34 individuals, 10 of which have 71 %" in text


def test_few_individuals_are_a_caution(made_up_run):
    run = RunFolder.read(made_up_run)

    def said(number, split="test"):
        table = rows(*(("a", i % 4, "Car", str(i), 5) for i in range(number))).assign(split=split)
        own = replace(run, individuals=table)
        return [s for s in cautions(own, seed_means(run.results)) if "individual" in s]

    assert said(FEW_INDIVIDUALS) == []
    (few,) = said(FEW_INDIVIDUALS - 1)
    assert few.startswith(f"Car: {5 * (FEW_INDIVIDUALS - 1)} test boxes are ")
    (one,) = said(1)
    assert one.startswith("Car: 5 test boxes are 1 individual:")
    assert said(1, "train") == []
    older = replace(run, individuals=None)
    assert not [s for s in cautions(older, seed_means(run.results)) if "individual" in s]
