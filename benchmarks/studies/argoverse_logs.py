"""Copy the four logs of docs/reality.md from a clone of Argoverse 2's API into a data set's layout.

    git clone --depth 1 https://github.com/argoverse/av2-api
    python benchmarks/studies/argoverse_logs.py av2-api data/argoverse2

They are test data of that repository: annotations and poses of four logs, three sweeps. One log
has the calibration of its rig; the vehicles are of one type, so the others get the same. The data
set may be used under CC BY-NC-SA 4.0 and its own terms.
"""

import shutil
import sys
from pathlib import Path

CALIBRATED = "7fab2350-7eaf-3b7e-a39d-6937a4c1bede"
LOGS = {
    CALIBRATED: "test_data/sensor/val",
    "adcf7d18-0510-35b0-a2fa-b4cea13a6d76": "test_data/sensor_dataset_logs",
    "3b3570b4-7b0b-3268-a571-b0889dbf40b6": "evaluation/scenario_mining/data",
    "3bffdcff-c3a7-38b6-a0f2-64196d130958": "evaluation/scenario_mining/data",
}
CALIBRATION = "calibration/egovehicle_SE3_sensor.feather"


def main(clone: Path, out: Path) -> None:
    tests = clone / "tests" / "unit"
    for log, folder in LOGS.items():
        source, target = tests / folder / log, out / "val" / log
        (annotations,) = source.glob("annotations*.feather")
        copies = {annotations: "annotations.feather"}
        copies[tests / LOGS[CALIBRATED] / CALIBRATED / CALIBRATION] = CALIBRATION
        for path in (source / "city_SE3_egovehicle.feather", *source.glob("sensors/lidar/*")):
            copies[path] = str(path.relative_to(source))
        for path, name in copies.items():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, target / name)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
