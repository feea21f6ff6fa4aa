# bash FILE [OPTIONS OF PARALLEL]: renders all tasks, then merges them. bash FILE task INDEX; bash FILE merge: a part of that.
case ${1-} in
task) render_task "$2" ;;
merge) merge_tasks ;;
*)
    script=$(realpath -- "$0")
    mkdir -p -- "$folder"
    seq 0 $((tasks - 1)) | parallel --quote --joblog "$folder/joblog" --jobs 1 "$@" bash "$script" task {}
    merge_tasks
    ;;
esac
