"""What MLflow's page of an experiment shows: a text, and a view of the runs by columns."""

import json
from collections.abc import Sequence

NOTE_TAG = "mlflow.note.content"
VIEW = "lidarplace"
"""Name of the view, in the page's address."""
_PIXELS = 7
"""Of a letter in the head of a column."""
VIEW_TAG = f"mlflow.sharedViewState.{VIEW}"


def view(columns: Sequence[str], ascending: bool, parent: str) -> str:
    """The state of the page's table, as MLflow's UI keeps it: columns, order, what is unfolded.

    Args:
        columns: by MLflow's names, such as "metrics.seconds"; the first orders.
        ascending: whether the lowest value is on top, else the highest.
        parent: id of the run whose children are shown.
    """
    ids = [_column(name) for name in columns]
    names = "attributes.`Run Name`"
    return json.dumps(
        {
            "selectedColumns": ids,
            "columnOrder": [names, *ids],
            "columnWidths": {names: 300} | {i: _PIXELS * len(i) for i in ids},
            "orderByKey": ids[0],
            "orderByAsc": ascending,
            "searchFilter": "",
            "startTime": "ALL",
            "lifecycleFilter": "Active",
            "modelVersionFilter": "All Runs",
            "datasetsFilter": [],
            "runsExpanded": {parent: True},
        }
    )


def page_of(experiment: str, has_view: bool) -> str:
    """The page of an experiment, with this view if it has one, below the server's address."""
    query = f"?viewStateShareKey={VIEW}&workflowType=machine_learning" if has_view else ""
    return f"/#/experiments/{experiment}/runs{query}"


def _column(name: str) -> str:
    kind, key = name.split(".", 1)
    return f"{kind}.`{key}`"
