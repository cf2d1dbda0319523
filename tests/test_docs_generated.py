"""Pages that are made from the code are what it makes now."""

import pytest

from docs import api, architecture, commands, configuration, run_folder, sensors
from tests.stage_names import stage_names

PAGES = [api, architecture, commands, configuration, run_folder, sensors]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.__name__)
def test_up_to_date(page):
    text = page.PAGE.read_text(encoding="utf-8")
    assert text == page.page(), f"out of date: python -m {page.__name__} makes it anew"


@pytest.mark.parametrize("picture", ["ROOMS", "FLOW"])
def test_pictures_are_of_today(picture):
    draw = {"ROOMS": architecture.rooms_picture, "FLOW": architecture.flow_picture}[picture]
    text = getattr(architecture, picture).read_text(encoding="utf-8")
    assert text == draw(), "out of date: python -m docs.architecture makes it anew"


def test_the_picture_of_the_data_has_every_stage():
    named = " ".join(stage for _, stage in architecture.ARROWS).replace(",", " ").replace(":", " ")
    assert stage_names() <= set(named.split())


@pytest.mark.parametrize("model", [configuration.SweepFile, configuration.SearchFile])
def test_every_key_has_a_description(model):
    schema = model.model_json_schema()
    for part in (schema, *schema["$defs"].values()):
        for key, field in part.get("properties", {}).items():
            assert field.get("description"), f"{part['title']}: {key} has no description"


@pytest.mark.parametrize("model", [run_folder.SweepResult, run_folder.SearchResult])
def test_every_key_of_a_run_folder_has_a_description(model):
    descriptions = {key: field.description for key, field in model.model_fields.items()}
    assert all(descriptions.values()), descriptions
