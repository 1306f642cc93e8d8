#!/usr/bin/env bash
# Filter a folder of logs as an array of jobs: sbatch --array=1-20 slurm_filter.sh RUNS SETUP.toml RESULTS [SHARDS]
# SHARDS is the array's last number; state it to submit a part of the array again.
# A job that is preempted, or whose node fails, goes back to the queue and takes up where it was: results are written
# whole or not at all, and the manifest says which are done.
#SBATCH --job-name=ftbias-filter
#SBATCH --cpus-per-task=2
#SBATCH --mem-per-cpu=2G
#SBATCH --time=02:00:00
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --signal=B:USR1@60
set -u
runs=$1 setup=$2 results=$3 shards=${4:-$SLURM_ARRAY_TASK_MAX}

# A minute before its time is up the job goes back to the queue by itself.
again() {
    kill -TERM "$child" 2>/dev/null
    wait "$child"
    echo "time is almost up: back to the queue"
    scontrol requeue "$SLURM_JOB_ID"
}
trap again USR1

ftbias filter "$runs" --setup "$setup" -o "$results" --jobs "${SLURM_CPUS_PER_TASK:-2}" \
    --shard "$SLURM_ARRAY_TASK_ID/$shards" &
child=$!
wait "$child"
code=$?

# 3: all is done, but samples or whole logs were lost; the manifest has the reasons, and another try would not help.
if [ "$code" = 3 ]; then
    echo "finished with data loss: see the manifest in $results"
    code=0
fi
exit "$code"
