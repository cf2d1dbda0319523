"""Packages that not every installation has, and the extra of this project that brings each."""

_PACKAGES = {
    "training": "torch",
    "sweeps": "alembic cmaes matplotlib mlflow optuna psutil ray requests sqlalchemy urllib3",
    "sumo": "libsumo sumo sumolib",
    "studio": "imageio viser websockets",
    "mesh": "trimesh",
    "carla": "carla",
    "mcap": "foxglove",
    "dashboard": "optuna_dashboard",
    "postgres": "psycopg2",
    "s3": "s3fs",
}

EXTRAS = {package: extra for extra, names in _PACKAGES.items() for package in names.split()}
"""Extra by the name under which a package is imported."""


def needs(error: ModuleNotFoundError) -> str | None:
    """Describe how to install a missing package; None if no extra brings it."""
    extra = EXTRAS.get(error.name or "")
    return extra and f"needs the package {error.name}: pip install 'lidarplace[{extra}]'"
