"""Rigs judged by detectors that are trained already, in portions of the test frames."""

from dataclasses import replace

from sweeps.tasks.parameters import CollectParams, JudgeParams
from sweeps.tasks.results import Evaluated, Judged
from sweeps.tasks.task import Task


def judge_task(evaluate: Task[Evaluated], first: int, every: int) -> Task[Judged]:
    """The detections that an evaluation starts from, in some frames and without kept clouds.

    Args:
        evaluate: the evaluation of a rig whose clouds are simulated.
        first, every: of the frames of each part of the scene.
    """
    training, *inputs = evaluate.inputs
    collected = [task for task in inputs if isinstance(task.params, CollectParams)]
    collection = replace(collected[0].params, first=first, every=every)
    return Task(
        "judge",
        f"{evaluate.label} · frames {first + 1} of {every}",
        JudgeParams(**vars(evaluate.params) | {"ious": (), "metrics": ()}, collection=collection),
        (training, *(scene for task in collected for scene in task.inputs)),
        gpu=True,
    )
