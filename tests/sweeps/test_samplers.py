"""Suggestions that can be repeated, by every sampler."""

import optuna
import pytest
from optuna.distributions import CategoricalDistribution, FloatDistribution

from sweeps.configuration.search import SAMPLERS
from sweeps.search.trials.samplers import Repeatable

pytestmark = pytest.mark.usefixtures("one_thread")

SPACE = {f"x{i}": FloatDistribution(0.0, 1.0) for i in range(3)}


def run(name, trials=12, distributions=SPACE, constrained=False):
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(sampler=Repeatable(name, seed=5))
    for _ in range(trials):
        trial = study.ask(distributions)
        if constrained:
            trial.set_constraint("c", 0.3 - trial.params["x0"])
        study.tell(trial, sum((trial.params[f"x{i}"] - 0.3 * i) ** 2 for i in range(3)))
    return [trial.params for trial in study.trials]


@pytest.mark.parametrize("name", SAMPLERS)
def test_the_same_seed_gives_the_same_trials(name):
    found = run(name)
    assert found == run(name)
    values = [value for params in found for value in params.values()]
    assert len(set(values)) > 0.9 * len(values)  # neither parameters nor trials repeat each other


@pytest.mark.parametrize("name", [name for name in SAMPLERS if name != "cmaes"])
def test_categories_and_constraints(name):
    space = SPACE | {"model": CategoricalDistribution(["a", "b"])}
    found = run(name, distributions=space, constrained=True)
    assert {params["model"] for params in found} == {"a", "b"}


def test_cma_es_starts_near_the_best_of_what_is_given():
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(sampler=Repeatable("cmaes", seed=5, enqueued=3))
    values = {0.1: 2.0, 0.8: 1.0, 0.5: 3.0}
    for x in values:
        study.enqueue_trial(dict.fromkeys(SPACE, x))
    for value in values.values():
        study.tell(study.ask(SPACE), value)
    asked = [study.ask(SPACE).params for _ in range(20)]
    means = [sum(params[name] for params in asked) / len(asked) for name in SPACE]
    assert means == pytest.approx([0.8] * 3, abs=0.08)
    assert all(abs(x - 0.8) < 0.5 for params in asked for x in params.values())


@pytest.mark.parametrize("name", ["tpe", "gp", "cmaes"])
def test_they_learn(name):
    def late(name):
        """Mean of the last trials."""
        last = run(name, trials=40)[-10:]
        return sum((p[f"x{i}"] - 0.3 * i) ** 2 for p in last for i in range(3)) / len(last)

    assert late(name) < late("random") / 2
