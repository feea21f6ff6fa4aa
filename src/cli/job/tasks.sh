# One task: makes those of its passes that its checkpoint does not hold yet.
render_task() {
    local first=$(($1 * per_task + 1)) last=$((($1 + 1) * per_task)) file
    ((last <= passes)) || last=$passes
    printf -v file '%s/tasks/%06d' "$folder" "$1"
    mkdir -p -- "$folder/tasks"
    exec volpm render "$scene" --quiet --pass-range "$first..$last" --fill "$file" "${options[@]}"
}

# After all tasks: pictures, and a checkpoint of all passes.
merge_tasks() {
    local files=() index file
    for ((index = 0; index < tasks; index++)); do
        printf -v file 'tasks/%06d' "$index"
        files+=("$file")
    done
    cd -- "$folder"
    exec volpm merge "${files[@]}" --quiet --passes "$passes" "${outs[@]}"
}
