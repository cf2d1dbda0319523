"""Columns and chart of a sweep's page at MLflow."""

import pytest

from sweeps.configuration.grid import read_sweep
from sweeps.mlflow.experiment import chart, columns, headline_column

AP = "metrics.AP_R40_3D.Car.0.70"
RECALL = "metrics.recall.all.0.50"


def surrogates(name: str) -> list[str]:
    return [f"metrics.surrogate.{surrogate}.{name}" for surrogate in ("s_mig", "expected_recall")]


@pytest.fixture
def sweep(tmp_path):
    (tmp_path / "a.yaml").write_text(
        "scene: {seed: 1}\nclasses: [Car, Cyclist]\ngrid: {placement: [line, center]}\n"
        "detector: pointpillars_tiny\n"
    )
    return read_sweep(tmp_path / "a.yaml")


def test_the_page_has_placement_surrogates_ap_and_recall_in_this_order(sweep):
    first = ["params.placement", *surrogates("Car"), AP, RECALL]
    of_cyclists = [*surrogates("Cyclist"), "metrics.AP_R40_3D.Cyclist.0.50"]
    assert columns(sweep) == [*first, *of_cyclists, "metrics.seconds"]


def test_ap_orders_the_page_and_its_chart_is_over_s_mig(sweep, tmp_path):
    assert headline_column(sweep) == AP
    assert chart(sweep) == ("metrics.surrogate.s_mig.Car", AP)
    (tmp_path / "b.yaml").write_text("grid: {placement: [line]}\ndetector: null\n")
    assert chart(read_sweep(tmp_path / "b.yaml")) is None
