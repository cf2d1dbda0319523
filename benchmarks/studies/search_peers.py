"""Searchers on one problem: best value against evaluations and against seconds.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/studies/search_peers.py

Every searcher gets the same problem (`examples/search.yaml` without its constraints, which CMA-ES
does not know), the same number of evaluations and the same machine, with several seeds: Optuna's
samplers one trial at a time, the library `cmaes` on its own, greedy choice from a grid of mounts,
TPE that begins with greedy's refined rig, and the paper's eight rigs. Writes a table of all runs, a
figure of medians and of the middle 80 % of the seeds, and prints what stands in docs/search.md.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import optuna
import pandas as pd

from lidarplace.command_line.terminal import output
from sweeps.execution.backends import InProcess
from sweeps.search.greedy.certificate import Certificate, certify, first_params
from sweeps.search.problem.assess import Traffic, assess
from sweeps.search.problem.problem import SearchProblem, read_problem
from sweeps.search.trials.samplers import Repeatable
from sweeps.search.trials.traffic import training_traffic
from sweeps.store.open import store_of

SAMPLERS = ("random", "qmc", "tpe", "gp", "cmaes", "nsga2", "nsga3")
LIFTED = ["search.constraints={distance: 0.0}", "ray=debug"]


def read(arguments: argparse.Namespace) -> SearchProblem:
    """The problem that all searchers get."""
    own = [f"output={arguments.output}", f"search.greedy.bound_seconds={arguments.bound_seconds}"]
    return read_problem(arguments.config, [*LIFTED, *own, *arguments.set])


def objective(problem: SearchProblem) -> Callable[[dict], float]:
    """The value of parameters; NaN if two LiDARs are in one place."""
    store = store_of(problem.sweep())
    traffic = training_traffic(output(), problem, store, InProcess())
    warm_up(problem, traffic)

    def value(params: dict) -> float:
        rig = problem.space.rig(problem.space.numbers[0], params)
        found = assess(rig, problem.criteria, traffic)
        return float("nan") if found.values is None else next(iter(found.values.values()))

    return value


def warm_up(problem: SearchProblem, traffic: Traffic) -> None:
    """Load the compiled code before the clock starts."""
    for rig in problem.paper_rigs().values():
        assess(rig, problem.criteria, traffic)


def by_sampler(
    problem: SearchProblem, name: str, seed: int, trials: int, first: dict | None
) -> list:
    """Best value so far and seconds after every evaluation, by a sampler of Optuna."""
    value = objective(problem)
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(direction="maximize", sampler=Repeatable(name, seed))
    if first is not None:
        study.enqueue_trial(first)
    best, rows, start = -np.inf, [], time.perf_counter()
    for number in range(trials):
        trial = study.ask(problem.space.distributions(problem.space.numbers[0]))
        found = value(trial.params)
        study.tell(trial, found if np.isfinite(found) else None,
                   state=None if np.isfinite(found) else optuna.trial.TrialState.FAIL)  # fmt: skip
        best = np.nanmax([best, found])
        rows.append((number + 1, time.perf_counter() - start, best))
    return rows


def by_cmaes(problem: SearchProblem, seed: int, trials: int) -> list:
    """The same by the library `cmaes`, from the middle of the space, without Optuna."""
    from cmaes import CMA

    value = objective(problem)
    space = problem.space.distributions(problem.space.numbers[0])
    low, high = (np.array([getattr(d, end) for d in space.values()]) for end in ("low", "high"))
    bounds = np.stack([np.zeros(len(low)), np.ones(len(low))], axis=1)
    search = CMA(mean=np.full(len(low), 0.5), sigma=1 / 6, bounds=bounds, seed=seed)
    best, rows, start = -np.inf, [], time.perf_counter()
    while len(rows) < trials:
        told = []
        for _ in range(search.population_size):
            x = search.ask()
            found = value(dict(zip(space, (low + x * (high - low)).tolist(), strict=True)))
            told.append((x, -found if np.isfinite(found) else 1e300))
            best = np.nanmax([best, found])
            rows.append((len(rows) + 1, time.perf_counter() - start, best))
        search.tell(told)
    return rows[:trials]


def run(job: tuple) -> pd.DataFrame:
    """One searcher with one seed."""
    arguments, name, seed, first = job
    problem = read(arguments)
    if name == "cmaes library":
        rows = by_cmaes(problem, seed, arguments.trials)
    else:
        sampler = "tpe" if first is not None else name
        rows = by_sampler(problem, sampler, seed, arguments.trials, first)
    table = pd.DataFrame(rows, columns=["evaluations", "seconds", "best"])
    return table.assign(searcher=name, seed=seed)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--config", type=Path, default=Path("examples/search.yaml"))
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument(
        "--searchers", nargs="+", default=[*SAMPLERS, "cmaes library", "refined + tpe"]
    )
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--bound-seconds", type=float, default=60.0)
    parser.add_argument("--output", type=Path, default=Path(tempfile.gettempdir()) / "peers")
    arguments = parser.parse_args()
    problem = read(arguments)
    store = store_of(problem.sweep())
    traffic = training_traffic(output(), problem, store, InProcess())
    warm_up(problem, traffic)
    start = time.perf_counter()
    paper = {
        name: next(iter((assess(rig, problem.criteria, traffic).values or {}).values()))
        for name, rig in problem.paper_rigs().items()
    }
    paper_seconds = time.perf_counter() - start
    certificate = certify(problem, traffic)
    first = first_params(problem, certificate)[0]
    jobs = [
        (arguments, name, seed, first if name == "refined + tpe" else None)
        for seed in range(arguments.seeds)
        for name in arguments.searchers
    ]
    with ProcessPoolExecutor(arguments.processes, mp_context=get_context("spawn")) as processes:
        runs = pd.concat(processes.map(run, jobs), ignore_index=True)
    # Greedy choice and refinement came before the first trial.
    begun = certificate.greedy_seconds + certificate.refine_seconds
    runs.loc[runs["searcher"] == "refined + tpe", "seconds"] += begun
    arguments.output.mkdir(parents=True, exist_ok=True)
    runs.to_parquet(arguments.output / "peers.parquet", index=False)
    last = runs[runs["evaluations"] == arguments.trials]
    table = last.groupby("searcher").agg(
        median=("best", "median"),
        low=("best", lambda v: v.quantile(0.1)),
        high=("best", lambda v: v.quantile(0.9)),
        seconds=("seconds", "median"),
    )
    best_paper = max(paper, key=paper.get)
    print(f"bound {certificate.bound:.6g}, by marginal gains {certificate.by_gains:.6g}")
    print(
        f"greedy {certificate.value:.6g}: {certificate.candidates} candidates, "
        f"{certificate.evaluations} gains, {certificate.greedy_seconds:.1f} s; bound "
        f"{certificate.bound_seconds:.1f} s"
    )
    print(
        f"refined from {certificate.refined_from} {certificate.refined_value:.6g}: "
        f"{certificate.refine_seconds:.1f} s more"
    )
    print(f"paper's eight: {best_paper} {paper[best_paper]:.6g}, {paper_seconds:.2f} s")
    print(table.sort_values("median", ascending=False).round(1).to_string())
    name = problem.file.search.objective[0].name
    draw(runs, certificate, name, paper[best_paper], best_paper, arguments.output / "peers.html")


def draw(
    runs: pd.DataFrame,
    certificate: Certificate,
    objective: str,
    paper: float,
    paper_name: str,
    path: Path,
) -> None:
    """Medians over seeds and the middle 80 %, against evaluations and against seconds."""
    from plotly.subplots import make_subplots

    from tracking.figures.kit.style import colour, theme

    figure = make_subplots(1, 2, shared_yaxes=True, horizontal_spacing=0.04)
    for i, (name, own) in enumerate(runs.groupby("searcher", sort=False)):
        by = own.groupby("evaluations")["best"]
        middle, low, high = by.median(), by.quantile(0.1), by.quantile(0.9)
        seconds = own.groupby("evaluations")["seconds"].median()
        rgb = ",".join(str(int(colour(i)[k : k + 2], 16)) for k in (1, 3, 5))
        dash = "solid" if i < 8 else "dot"
        for column, x in ((1, middle.index), (2, seconds)):
            line = {"color": colour(i), "width": 2, "dash": dash}
            figure.add_scatter(x=x, y=middle, name=name, legendgroup=name, line=line, mode="lines",
                               showlegend=column == 1, row=1, col=column)  # fmt: skip
            figure.add_scatter(
                x=np.concatenate([x, x[::-1]]), y=np.concatenate([high, low[::-1]]), fill="toself",
                fillcolor=f"rgba({rgb},0.12)", line={"width": 0}, legendgroup=name,
                showlegend=False, hoverinfo="skip", row=1, col=column,
            )  # fmt: skip
    for value, text in (
        (certificate.bound, "no choice of candidates exceeds"),
        (certificate.refined_value, "refined"),
        (paper, f"{paper_name}, best of the paper's eight"),
    ):
        line = {"dash": "dash", "width": 1, "color": "#777777"}
        where = "bottom right"
        figure.add_hline(value, line=line, annotation_text=text, annotation_position=where, col=1)
        figure.add_hline(value, line=line, col=2)
    figure.add_scatter(
        x=[certificate.greedy_seconds],
        y=[certificate.value],
        mode="markers+text",
        marker={"color": "#1d2126", "size": 10, "symbol": "star"},
        text=["greedy"],
        textposition="top center",
        showlegend=False,
        row=1,
        col=2,
    )
    figure.update_xaxes(title="evaluations", col=1)
    figure.update_xaxes(title="seconds", type="log", col=2)
    figure.update_yaxes(title=f"{objective} (nats), best so far", col=1)
    figure.update_layout(
        template=theme(False),
        height=520,
        width=1240,
        paper_bgcolor="#ffffff",
        margin={"t": 20, "b": 60},
    )
    figure.write_html(path, include_plotlyjs=True, config={"displayModeBar": False})
    print(path)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
