# bash FILE [OPTIONS OF SBATCH]: submits the array of tasks, and the merge that waits for it. As a job: sbatch FILE task;
# sbatch --array=0 FILE merge.
case ${1-} in
task) render_task "${2-$SLURM_ARRAY_TASK_ID}" ;;
merge) merge_tasks ;;
*)
    array=$(sbatch --parsable "$@" "$0" task)
    merge=$(sbatch --parsable "$@" --array=0 --dependency="afterok:${array%%;*}" \
        --kill-on-invalid-dep=yes "$0" merge)
    echo "tasks: job ${array%%;*}; merge: job ${merge%%;*}"
    ;;
esac
