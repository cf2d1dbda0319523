"""`python -m sweeps.run grid.yaml` is `lidarplace run grid.yaml`."""

from sweeps.main import main

if __name__ == "__main__":
    main("run")
