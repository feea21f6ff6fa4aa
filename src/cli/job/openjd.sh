# What the parameters of the job say.
scene=$1 folder=$2 options=() outs=()
[[ $3 == 0 ]] || options+=(--threads "$3")
[[ -z $4 ]] || options+=(--memory "$4")
while IFS= read -r line; do
    [[ -z $line ]] || options+=("--set=$line")
done <<<"$5"
while IFS= read -r line; do
    [[ -z $line ]] || outs+=("--out=$line")
done <<<"$6"
