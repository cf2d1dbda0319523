#!/bin/bash
# A sweep on machines of Slurm, in a folder that all of them share and that holds .venv:
#   sbatch slurm.sh grid.yaml
#SBATCH --job-name=sweep
#SBATCH --nodes=4
#SBATCH --ntasks-per-node=1
#SBATCH --cpus-per-task=16
#SBATCH --mem=48G
#SBATCH --time=2-00:00:00
#SBATCH --requeue
# For trainings on a GPU: #SBATCH --gpus-per-node=1

set -euo pipefail
config=${1:?usage: sbatch slurm.sh grid.yaml}
# shellcheck source=/dev/null
source .venv/bin/activate

# Only processes of this job know the token.
RAY_AUTH_TOKEN=$(python -c 'import secrets; print(secrets.token_hex(16))')
export RAY_AUTH_MODE=token RAY_AUTH_TOKEN RAY_USAGE_STATS_ENABLED=0
ip=$(hostname --ip-address | cut --delimiter=' ' --fields=1)
address=$ip:$((30000 + SLURM_JOB_ID % 10000))
node=(ray start --block --disable-usage-stats
    "--num-cpus=$SLURM_CPUS_PER_TASK" "--num-gpus=${SLURM_GPUS_ON_NODE:-0}")

# This script runs on the first machine, with the head and the driver.
srun --overlap --nodes=1 --ntasks=1 --nodelist="$SLURMD_NODENAME" \
    "${node[@]}" --head --node-ip-address="$ip" --port="${address##*:}" \
    --include-dashboard=false --temp-dir="/tmp/ray-$SLURM_JOB_ID" &
for _ in {1..60}; do
    ray status --address="$address" > /dev/null 2>&1 && break
    sleep 2
done

others=$((SLURM_JOB_NUM_NODES - 1))
if ((others > 0)); then
    srun --overlap --nodes="$others" --ntasks="$others" --exclude="$SLURMD_NODENAME" \
        "${node[@]}" --address="$address" &
fi

# Machines that come later join the running sweep. Slurm ends Ray's processes with this script.
lidarplace run "$config" --set "ray=$address"
