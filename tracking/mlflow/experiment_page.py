"""Pages of MLflow: a text, a view of the runs by columns, and who runs which code."""

import json
import subprocess
from importlib.metadata import version
from pathlib import Path

import tracking
from tracking.mlflow.content import ParentRun

NOTE_TAG = "mlflow.note.content"
VIEW = "lidarplace"  # name of the view, in the page's address
_PIXELS = 7  # of a letter in the head of a column
VIEW_TAG = f"mlflow.sharedViewState.{VIEW}"


def view(content: ParentRun, parent: str) -> str:
    """Write the state of the page as MLflow's UI keeps it: columns, order, open runs, a chart.

    `parent` is the id of the run whose children are listed."""
    ids = [_quoted(name) for name in content.columns]
    names = "attributes.`Run Name`"
    widths = {names: 300} | {i: _PIXELS * len(i) for i in ids}
    selection = {"selectedColumns": ids, "columnOrder": [names, *ids], "columnWidths": widths}
    order = {
        "orderByKey": _quoted(content.order_by or content.columns[0]),
        "orderByAsc": content.ascending,
    }
    every = {"searchFilter": "", "startTime": "ALL", "datasetsFilter": []}
    every |= {"lifecycleFilter": "Active", "modelVersionFilter": "All Runs"}
    state = {**selection, **order, **every, "runsExpanded": {parent: True}}
    return json.dumps(state | _chart(content.chart) if content.chart else state)


def _quoted(column: str) -> str:
    kind, key = column.split(".", 1)
    return f"{kind}.`{key}`"


def _chart(columns: tuple[str, str]) -> dict[str, object]:
    """Make the state of MLflow's chart view: a section with a scatter of two metrics."""
    x, y = (column.split(".", 1)[1] for column in columns)
    common = {"isGenerated": False, "deleted": False}
    axes = {"xaxis": {"type": "METRIC", "key": x}, "yaxis": {"type": "METRIC", "key": y}}
    card = {"uuid": f"{VIEW}-scatter", "type": "SCATTER", "metricSectionId": VIEW, **common, **axes}
    section = {"uuid": VIEW, "name": f"{y} over {x}", "display": True, "isReordered": False}
    charts = {"compareRunCharts": [card], "compareRunSections": [section | common]}
    return {**charts, "runsHiddenMode": "SHOWALL"}


def page_of(experiment: str, has_view: bool) -> str:
    """Return the page of an experiment below the server's address, with the view if it has one."""
    query = f"?viewStateShareKey={VIEW}&workflowType=machine_learning" if has_view else ""
    return f"/#/experiments/{experiment}/runs{query}"


VERSION_TAG = "lidarplace.version"


def source_tags() -> dict[str, str]:
    """Make MLflow's tags for this process.

    The version, and in a checkout the commit and whether files differ from it."""
    from mlflow.tracking.context.default_context import DefaultRunContext
    from mlflow.utils.mlflow_tags import MLFLOW_GIT_COMMIT, MLFLOW_GIT_DIRTY

    tags = {name: str(value) for name, value in DefaultRunContext().tags().items()}
    tags[VERSION_TAG] = version("lidarplace")
    root = Path(tracking.__path__[0]).parent
    if (root / ".git").exists():
        commit = _git(root, "rev-parse", "HEAD")
        changed = _git(root, "status", "--porcelain", "--untracked-files=no")
        if commit is not None and changed is not None:
            tags[MLFLOW_GIT_COMMIT] = commit
            tags[MLFLOW_GIT_DIRTY] = str(bool(changed)).lower()
    return {name: value for name, value in tags.items() if value}


def _git(root: Path, *words: str) -> str | None:
    """Return the output of git; None where it is not installed, or refuses."""
    try:
        process = subprocess.run(
            ["git", "-C", str(root), *words], capture_output=True, text=True, timeout=30
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return None if process.returncode else process.stdout.strip()
