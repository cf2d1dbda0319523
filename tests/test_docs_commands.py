"""Commands, configurations and Python of the docs work as they stand there.

A command runs in a folder with tiny files of the names that it uses, or it is in NOT_RUN with the
reason why it cannot; then its files and options are looked up. Nothing may be in neither.
"""

import importlib.util
import re
import shlex
from pathlib import Path

import pytest

from lidarplace.configuration.yaml import parse_yaml
from sweeps.command_line import VERBS
from sweeps.command_line import app as lidarplace
from sweeps.plan.plan import read_plan
from sweeps.store.open import reference
from tests.docs_blocks import ROOT, Block, blocks, commands, commands_in_text
from tests.docs_world import app_of, check_options, make_world, prepare, run

NOT_RUN = {
    "make ": "sets up an environment; starts servers",
    "pip install ": "needs a package index",
    "git clone ": "needs the network",
    "docker ": "builds an image",
    "pre-commit install": "writes into the repository",
    ". .venv/bin/activate": "of the shell",
    "./CarlaUE4.sh ": "needs CARLA",
    "lidarplace carla ": "needs a CARLA server",
    "cd /shared/sweeps ": "needs several machines",
    "(umask 077; ": "needs several machines",
    "export RAY_AUTH_MODE": "needs several machines",
    "ray start ": "needs several machines",
    "ray stop": "would end other people's Ray",
    "lidarplace run grid.yaml --set ray=10.0.0.1:6379": "needs several machines",
    "sbatch ": "needs Slurm",
    "python -m mlflow server ": "needs PostgreSQL",
    "lidarplace dashboard": "a server; tests/tracking/test_dashboard.py starts it",
    "lidarplace validate ": "needs real points; tests/lidarplace/validation runs it",
    "lidarplace studio": "a server; tests/lidarplace/studio/test_page.py starts it",
    "python -m pytest": "would test within a test",
    "pytest ": "would test within a test",
    "python benchmarks/": "takes minutes, and an idle machine",
    "lidarplace run grid.yaml --set training.checkpoint=pv_rcnn_8369.pth": "not at hand",
    "lidarplace cheapest examples/cheapest.yaml": "a minute; see test_cheapest.py",
    "lidarplace run grid.yaml --set evaluator=pretrained": "see tests/sweeps/test_pretrained.py",
    "lidarplace pretrain studies/pretrained/": "takes hours",
    "lidarplace run sweep.yaml --set training.mixed_precision": "a sweep of one's own",
    "lidarplace search studies/proof/search.yaml": "takes 20 minutes",
    "python studies/proof/contrast.py": "reads the runs of the proof",
    "uv pip install ": "installs for a minute",
    "lidarplace --install-completion": "changes the shell's own files",
    "lidarplace --show-completion": "depends on the shell",
}
"""How commands begin that are only looked up, and why."""

SMALLER = {
    "init": "begin",
    "pretrain": "--set training.epochs=1",
    "export": "--roi 0 20 -10 10 0 4",
    "examples/labels/sweep.yaml": "--set ray=debug --set detector=null --set grid.seed=[1] "
    "--set lidar.cloud_share=0.02 --set surrogate.resolution=0.8",
    "examples/command_evaluator/sweep.yaml": "--set ray=debug --set lidar.cloud_share=0.05 "
    "--set scene.routes=1 --set scene.test_routes=1 --set scene.frames_per_route=4 "
    "--set scene.pedestrians=5 --set scene.warmup_s=5 --set surrogate.resolution=0.8",
    "mine.yaml": "--set ray=debug --set lidar.azimuth_steps=90 --set lidar.beams=4 "
    "--set scene.routes=2 --set scene.test_routes=1 --set scene.frame_stride=40 "
    "--set scene.pedestrians=5 --set scene.frames_per_route=4 --set scene.warmup_s=5 "
    "--set surrogate.resolution=0.8 --set surrogate.accuracy=false "
    "--set surrogate.sampling_error=false --set training.epochs=1 --set grid.seed=[1] "
    "--set grid.placement=[line,mine]",
}
"""What makes a command cheap, by its verb or by its configuration."""

PLACEHOLDERS = {"runs/NAME": "runs/search", "LOG": "small", "data/argoverse2": "data/av2/sensor"}


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    pytest.importorskip("sumolib")
    folder = tmp_path_factory.mktemp("docs")
    before = Path.cwd()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        make_world(folder)
        yield folder
        patch.chdir(before)


def listed(command: str) -> str | None:
    """Start of the command in NOT_RUN, if any; variables before it do not count."""
    bare = re.sub(r"^([A-Z_]+=\S* )+", "", command).removeprefix(".venv/bin/")
    return next((start for start in NOT_RUN if bare == start or bare.startswith(start)), None)


FIRST = {"README.md", "data.md", "label_files.md", "data_sets.md", "traffic.md", "rigs.md"}
"""Pages whose commands run in every test; the others repeat these with other settings."""
RUN = [
    pytest.param(command, id=str(command), marks=() if command.page in FIRST else pytest.mark.long)
    for command in commands()
    if listed(command.text) is None
]
PYTHON = blocks("python")
LOOKED_UP = [c for c in commands() if listed(c.text)] + commands_in_text()


@pytest.mark.parametrize("command", RUN)
def test_runs(command, world):
    if ".mcap" in command.text:
        pytest.importorskip("foxglove")
    words = shlex.split(command.text)
    program, verb, *arguments = words
    assert program == "lidarplace", f"{command.text}: neither runs nor is listed"
    arguments = [PLACEHOLDERS.get(argument, argument) for argument in arguments]
    prepare(" ".join([verb, *arguments]))
    if "--forget" in arguments:  # the name ends in a hash of the output folder
        sweep, _ = read_plan(world / "grid.yaml", ["name=old"])
        arguments[-1] = reference(sweep)
    for name in (verb, *arguments[:1]):
        if not (name == "mine.yaml" and verb != "run"):
            arguments += SMALLER.get(name, "").split()
    result = run(verb, *arguments)
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize("command", LOOKED_UP, ids=str)
def test_what_it_names_is_there(command):
    """Programs and options of what cannot run here, and of commands in the text."""
    if "…" in command.text:
        pytest.skip("a pattern of commands, not one")
    words = shlex.split(re.sub(r"^([A-Z_]+=\S* )+", "", command.text))
    program = words[:3] if words[1:2] == ["-m"] else words[:2]
    if words[0] == "make":
        for target in re.findall(r"make (\w+)", command.text):
            assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.M), target
    elif program[-1] == "pytest" or words[0] == "pytest":
        look_up_tests(words[words.index("pytest") + 1 :])
    elif words[0].endswith("python") and program[1] == "-m":
        assert importlib.util.find_spec(program[2].split(".")[0]), program[2]
    elif words[0].endswith("python") and program[1] != "-c":
        script = (ROOT / program[1]).read_text(encoding="utf-8")
        for option in (word for word in words[2:] if word.startswith("--")):
            name = option[2:].partition("=")[0]
            assert option in script or name.replace("-", "_") in script, option
    elif words[0] == "lidarplace" and words[1].startswith("-"):
        check_options(lidarplace, words[1:])
    elif words[0] == "lidarplace":
        assert words[1] in VERBS
        check_options(app_of(words[1]), words[2:])


def look_up_tests(words: list[str]) -> None:
    """Files, and words of -k, which have to occur in them."""
    chosen = [ROOT / word.partition("::")[0] for word in words if word.startswith("tests")]
    assert all(path.exists() for path in chosen), words
    if "-k" in words:
        files = [file for path in chosen for file in ([path], path.rglob("*.py"))[path.is_dir()]]
        text = "\n".join(f"{file}\n{file.read_text(encoding='utf-8')}" for file in files)
        for word in re.findall(r"\w+", words[words.index("-k") + 1]):
            assert word in ("and", "or", "not") or word in text, f"-k {word} selects nothing"


def test_every_reason_is_needed():
    used = {listed(command.text) for command in commands()}
    assert set(NOT_RUN) - used == set(), "no command begins like that"


def alternatives(text: str) -> list[str]:
    """The configurations of a block: a key that occurs twice shows two ways to write it."""
    entries = re.findall(r"^\S.*\n(?:(?:[ #].*)?\n)*", text, re.M)
    keys = [entry.partition(":")[0] for entry in entries]
    if len(set(keys)) < len(keys):
        once = [entry for entry, key in zip(entries, keys, strict=True) if keys.count(key) == 1]
        several = [e for e, key in zip(entries, keys, strict=True) if keys.count(key) > 1]
        return ["".join([*once, entry]) for entry in several]
    if len(entries) == 1 and "\n  " in text and not text.startswith("#"):
        head, _, rest = text.partition("\n")
        inner = "\n".join(line.removeprefix("  ") for line in rest.splitlines()) + "\n"
        if re.search(r"^\w+:", inner, re.M):
            indented = [re.sub(r"^(?=.)", "  ", part, flags=re.M) for part in alternatives(inner)]
            return [f"{head}\n{part}" for part in indented]
    return [text]


def of_kind(block: Block) -> str:
    keys = set(re.findall(r"^([\w.]+):", block.text, re.M))
    if block.page == "carla.md":
        return "collection"
    if "requirements" in keys and "grid" not in keys:
        return "requirements"
    if "columns" in keys:
        return "mapping"
    if "factor" in keys:
        return "correction"
    if keys & {"search", "robustness", "verify"}:
        return "search"
    return "class map" if any(key.startswith("vehicle.") for key in keys) else "sweep"


@pytest.mark.parametrize("block", blocks("yaml"), ids=str)
def test_configurations(block, world):
    for number, text in enumerate(alternatives(block.text)):
        assert "…" not in re.sub(r"#.*|://…", "", text), "a value is left out"
        content = parse_yaml(text.replace("://…", "://host/db"))
        path = world / f"block-{block.page}-{block.number}-{number}.yaml"
        check(of_kind(block), content, path)


def check(kind: str, content: dict, path: Path) -> None:
    """Raises an error that names the key if the content is not a file of that kind."""
    import yaml

    from lidarplace.configuration.correction import read_correction
    from lidarplace.plugins.carla.command import Collection
    from lidarplace.scenes.datasets.class_maps import named_class_map
    from lidarplace.scenes.label_tables.mapping import read_mapping
    from sweeps.configuration.grid import read_sweep
    from sweeps.configuration.requirements_file import read_requirements_check
    from sweeps.search.problem.problem import read_problem

    if kind == "requirements":
        path.write_text(yaml.safe_dump(content, sort_keys=False))
        read_requirements_check(path)
        return
    if kind == "collection":
        Collection.model_validate(content)
        return
    if kind == "search":
        base = {"search": {"zones": {"roof": {"x": 0, "y": [-1, 1], "z": 1.8}}}}
        content = base | content
        content["search"] = base["search"] | content["search"]
    elif kind == "sweep":
        axis = {} if "grid" in content and "placement" in content["grid"] else {"placement": "line"}
        content = axis | content
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    readers = {
        "search": read_problem,
        "sweep": read_sweep,
        "class map": lambda path: named_class_map(str(path)),
        "mapping": read_mapping,
        "correction": read_correction,
    }
    readers[kind](path)


TRAINED = pytest.mark.long  # the block reads what two sweeps have logged


@pytest.mark.parametrize(
    "block",
    [pytest.param(b, id=str(b), marks=TRAINED if "names=[" in b.text else ()) for b in PYTHON],
)
def test_python(block, world, monkeypatch):
    prepare(block.text)
    exec(block.text, {})


def test_alternatives():
    assert alternatives("a: 1\na: 2\nb: 3\n") == ["b: 3\na: 1\n", "b: 3\na: 2\n"]
    assert alternatives("s:\n  o: 1\n  o: 2\n") == ["s:\n  o: 1\n", "s:\n  o: 2\n"]
    assert alternatives("s:\n  o: 1\n  p: 2\n") == ["s:\n  o: 1\n  p: 2\n"]
