"""A report section is two files, as docs/extending.md has them."""

from tests.extending import blocks_of, check_layers, copy_tree, put, python
from tests.tracking.made_up_run import NAMES, write_run


def test_a_report_section_is_two_files(tmp_path):
    tree = copy_tree(tmp_path)
    section, lines = blocks_of("A report section")
    imported, call = lines.split("\n\n")
    build = tree / "tracking/report/build.py"
    (tree / "tracking/report/sections/trainings.py").write_text(section, encoding="utf-8")
    put(build, "from tracking.report.sections.where_time_went import", f"{imported}\n")
    put(build, "    yield where_time_went(run)", call)

    run = write_run(tree / "made_up", seeds=(1, 2, 3), points=10)
    python(tree, "-m", "tracking.report", "made_up")
    page = (run / "report.html").read_text(encoding="utf-8")
    assert 'href="#trainings"' in page
    assert 'id="trainings"' in page
    assert "## Trainings" in (run / "report.md").read_text(encoding="utf-8")
    rows = (run / "tables/trainings.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0] == "placement,trainings"
    assert [row.rpartition(",")[2] for row in rows[1:]] == ["3"] * len(NAMES)
    check_layers(tree)
