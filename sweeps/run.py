"""`python -m sweeps.run grid.yaml` is `lidarplace run grid.yaml`."""

from sweeps.command_line import main

if __name__ == "__main__":
    main("run")
