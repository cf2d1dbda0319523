"""Packages that not every installation has: which extra of this project brings one."""

EXTRAS = {
    "torch": "training",
    "cmaes": "sweeps",
    "matplotlib": "sweeps",
    "mlflow": "sweeps",
    "optuna": "sweeps",
    "psutil": "sweeps",
    "ray": "sweeps",
    "requests": "sweeps",
    "sqlalchemy": "sweeps",
    "urllib3": "sweeps",
    "libsumo": "sumo",
    "sumo": "sumo",
    "sumolib": "sumo",
    "imageio": "studio",
    "viser": "studio",
    "websockets": "studio",
    "trimesh": "mesh",
    "carla": "carla",
    "foxglove": "mcap",
    "optuna_dashboard": "dashboard",
    "psycopg2": "postgres",
    "s3fs": "s3",
}
"""The extra by the name under which a package is imported."""


def needs(error: ModuleNotFoundError) -> str | None:
    """What to do about a package that is not installed, None if no extra brings it."""
    extra = EXTRAS.get(error.name or "")
    return extra and f"needs the package {error.name}: pip install 'lidarplace[{extra}]'"
