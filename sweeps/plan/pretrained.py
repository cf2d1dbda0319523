"""Evaluation of placements by a detector whose weights are in a file."""

from lidarplace.base.errors import InputError
from sweeps.configuration.sweep import Common
from sweeps.plan import named_files
from sweeps.plan.clouds import TrialClouds, as_collected
from sweeps.plan.trial import DetectorTrial, Trial
from sweeps.stages.evaluate import EvaluateStage
from sweeps.stages.train import PretrainedStage
from training.nvidia import device_of_networks
from training.settings import PRETRAINED, TrainingSettings
from training.typical_objects import TypicalObject

ON_GPU = "networks run on the GPU, which casts clouds that are not kept"


def uses_gpu(common: Common) -> bool:
    """Test if networks can use a GPU of this machine, and the configuration lets them."""
    return common.ray.num_gpus != 0 and device_of_networks() == "cuda"


def plan_pretrained(
    trial: Trial, clouds: TrialClouds, typical: tuple[TypicalObject, ...]
) -> DetectorTrial:
    """Evaluate by pretrained weights, which have their own typical objects."""
    planning, point = clouds.planning, trial.grid_point.point
    rig = as_collected(planning, point, trial.grid_point.rig)
    outside = named_files.outside_of(point, rig)
    if outside is not None:
        raise InputError(outside, key=f"placement: {point.placement!r}")
    generalist = named_files.generalist_of(point)
    path = point.training.checkpoint or PRETRAINED
    weights = planning.add(PretrainedStage(generalist.digest, path), path.name)
    # Nothing is trained: what decides trainings alone is in no key.
    of_detection = {"batch_size", "mixed_precision", "score_threshold", "nms_threshold"}
    settings = TrainingSettings().model_copy(
        update={name: getattr(point.training, name) for name in of_detection}
    )
    truths, test = clouds.truths["test"], clouds.collect("test")
    stage = EvaluateStage(
        generalist.detector,
        point.classes,
        settings,
        clouds.crop,
        typical=generalist.typical,
        ious=tuple(point.own_ious().items()),
        metrics=point.metrics,
        gpu=uses_gpu(planning.sweep.common),
    )
    return DetectorTrial(
        **vars(trial),
        ground_truths=tuple(dict.fromkeys(truths)),
        collect_test=tuple(test),
        finetune=None,
        evaluate=planning.add(stage, trial.label, (weights, *test, *truths)),
    )
