#!/bin/bash
# All rows of the crossover into one folder:
#   scripts/crossover.sh [--resume] [--minutes M] DIR [SPONZA.gltf] [-- OPTION...]
#   --resume     DIR holds rows of an earlier run: what they lack is measured
#   --minutes M  begin nothing more after so long (default 100); the same command with --resume goes on. What is
#                under way then is finished, and the references of a row are traced in one go
#   SPONZA.gltf  the scene of two rows; without it they are skipped
#   OPTION...    for each row's lightwell-load crossover, after --repeats 5 --real-clock
# LW_BIN says where lightwell-load is (default: build/release/bin). Ends with 75 where something is still missing.
set -euo pipefail
here=$(cd "$(dirname "$0")/.." && pwd)
load=${LW_BIN:-$here/build/release/bin}/lightwell-load
resume=
minutes=100

fail() {
    echo "crossover.sh: $1" >&2
    exit 64
}

while [ $# -gt 0 ]; do
    case $1 in
    --resume) resume=1 ;;
    --minutes)
        [ $# -gt 1 ] || fail '--minutes wants a number'
        minutes=$2
        shift
        ;;
    --) fail 'DIR is missing' ;;
    -*) fail "no such option: $1" ;;
    *) break ;;
    esac
    shift
done
[ $# -gt 0 ] || fail 'DIR is missing'
[[ $minutes =~ ^[0-9]+$ && $minutes -gt 0 ]] || fail "--minutes $minutes: not a whole number above 0"
folder=$1
shift
sponza=
if [ $# -gt 0 ] && [ "$1" != -- ]; then
    sponza=$1
    shift
fi
if [ $# -gt 0 ]; then
    [ "$1" = -- ] || fail "what is $1 for?"
    shift
fi
[ -x "$load" ] || fail "$load is not there: make, or set LW_BIN"
[ -n "$resume" ] || [ -z "$(ls -A "$folder" 2>/dev/null)" ] ||
    fail "$folder is not empty: --resume goes on with it"
mkdir -p "$folder" || exit 73

end=$(($(date +%s) + 60 * minutes))
missing=0
rows=()
declare -A why # by row: the last line of one that failed

# row NAME SCENE MOTION
row() {
    local left=$((end - $(date +%s))) code=0
    rows+=("$1")
    if [ $left -le 0 ]; then
        echo "crossover.sh: $1: time is up" >&2
        missing=1
        return
    fi
    echo "crossover.sh: $1" >&2
    {
        "$load" crossover "$2" --motion "$3" -o "$folder/$1" --repeats 5 --real-clock \
            --minutes "$(awk "BEGIN { print $left / 60 }")" "${options[@]}" 2>&1 >&3 |
            tee "$folder/$1.log" >&2
    } 3>&1 || code=$?
    if [ $code -ne 0 ]; then
        echo "crossover.sh: $1 ended with $code" >&2
        missing=1
        why[$1]=$(tail -n 1 "$folder/$1.log")
    fi
    rm -f "$folder/$1.log"
    # an interruption and a disk that is full are no matter of one row
    if [ -n "$stopped" ] || [ $code -eq 73 ] || [ $code -eq 74 ]; then
        summarise
        exit $((code == 73 || code == 74 ? code : 75))
    fi
}

# What a row's report begins with, or why there is none.
summarise_row() {
    local report=$folder/$1/report.md
    if [ -f "$report" ]; then
        grep -e '^\* at the error of' -e '^\*\*Not measured:' -e '^Nothing moves:' "$report" ||
            echo 'No opponent with a filter is measured.'
        printf '\n[report](%s/report.md)\n' "$1"
    else
        echo 'Not measured.'
    fi
    [ -z "${why[$1]:-}" ] || printf '\nIt ended with: `%s`\n' "${why[$1]}"
}

# The rows that are void, then the first lines of each row's report.
summarise() {
    local void=
    for name in "${rows[@]}"; do
        ! grep -qs '^\* at the error of.*\*\*(void)\*\*' "$folder/$name/report.md" || void="$void, $name"
    done
    {
        echo '# The crossover, row by row'
        [ -z "$void" ] || printf '\nVoid against some opponent, since late light errs too little: %s.\n' "${void#, }"
        for name in "${rows[@]}"; do
            printf '\n## %s\n\n' "$name"
            summarise_row "$name"
        done
    } >"$folder/report.md.new"
    mv "$folder/report.md.new" "$folder/report.md"
    echo "crossover.sh: $folder/report.md" >&2
}

options=("$@")
stopped=
trap 'stopped=1' INT TERM
row atrium-lamp-walk builtin:atrium-matt lamp-walk
row atrium-sun-swing builtin:atrium-matt sun-swing
row atrium-lamp-switch builtin:atrium-matt lamp-switch
row atrium-carry builtin:atrium-matt carry
row atrium-static builtin:atrium-matt static
if [ -n "$sponza" ]; then
    row sponza-lamp-walk "$sponza" lamp-walk
    row sponza-sun-swing "$sponza" sun-swing
else
    echo 'crossover.sh: the rows of Sponza are skipped: no scene is given' >&2
fi
row city builtin:city all
summarise
exit $((missing ? 75 : 0))
