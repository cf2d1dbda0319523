"""The best detectors of a sweep as models of MLflow, each linked to the run that trained it."""

from typing import Any

from tracking.mlflow.connection import every
from tracking.mlflow.content import Model

BEST_TAG = "lidarplace.best"
_SWEEP_TAG = "lidarplace.sweep"
_TRIAL_TAG = "lidarplace.trial"


def write_model(client: Any, experiment: str, sweep: str, run: Any, model: Model) -> None:
    """Log a model unless it is there, and mark it, and no other of its name, as the best.

    One that a killed driver left half way is continued. So any model may be written again.

    Args:
        sweep: key of the sweep.
        run: of the trial that it is from.
    """
    from mlflow.entities import LoggedModelOutput, LoggedModelStatus

    wanted = f"name = '{model.name}' AND tags.`{_SWEEP_TAG}` = '{sweep}'"
    known = every(client.search_logged_models, [experiment], filter_string=wanted)
    own = next((one for one in known if one.tags[_TRIAL_TAG] == model.trial), None)
    if own is None:
        own = client.create_logged_model(
            experiment,
            model.name,
            source_run_id=run.info.run_id,
            tags={_SWEEP_TAG: sweep, _TRIAL_TAG: model.trial},
            params={name: str(value) for name, value in model.params.items()},
            model_type="detector",
        )
    if own.status != LoggedModelStatus.READY:
        client.log_model_artifacts(own.model_id, str(model.folder))
        outputs = client.get_run(run.info.run_id).outputs
        linked = [output.model_id for output in outputs.model_outputs] if outputs else []
        if own.model_id not in linked:  # MLflow refuses a second link
            client.log_outputs(run.info.run_id, [LoggedModelOutput(own.model_id, step=0)])
        client.finalize_logged_model(own.model_id, LoggedModelStatus.READY)
    for other in known:
        if other.model_id != own.model_id and other.tags.get(BEST_TAG) == "true":
            client.set_logged_model_tags(other.model_id, {BEST_TAG: "false"})
    client.set_logged_model_tags(own.model_id, {BEST_TAG: "true"})
