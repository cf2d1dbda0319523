# lidarplace in a container, with PyTorch for the CPU: 2.5 GB of packages on top of the base image.
#   docker build -t lidarplace .
#   docker build -t lidarplace --build-arg TORCH_BACKEND=cu128 .     # CUDA: the driver's build, larger
#   docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/work" lidarplace run examples/demo.yaml
FROM python:3.11-slim

# cpu, or the build of PyTorch for the driver, such as cu128.
ARG TORCH_BACKEND=cpu

# SUMO's programs link these, and a slim image lacks them.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends \
        libatomic1 libexpat1 libgl1 libx11-6 libxext6 libxrender1 \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /opt/lidarplace
COPY constraints.txt pyproject.toml README.md LICENSE ./
COPY lidarplace lidarplace
COPY training training
COPY tracking tracking
COPY sweeps sweeps
# The examples of `lidarplace init` are links to these.
COPY examples examples
RUN pip install --no-cache-dir --constraint constraints.txt uv \
    && uv pip install --system --no-cache --constraint constraints.txt \
        --torch-backend ${TORCH_BACKEND} ".[all]"

# Any user may run the image: caches of kernels and settings are written here.
ENV HOME=/tmp MLFLOW_DISABLE_TELEMETRY=true RAY_USAGE_STATS_ENABLED=0
USER 1000
WORKDIR /work
ENTRYPOINT ["lidarplace"]
CMD ["--help"]
