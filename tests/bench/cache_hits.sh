#!/bin/bash
# cache_hits.sh [--frames N] [--density D] [--l1 SIZE,WAYS,LINE] [--l2 SIZE,WAYS,LINE] [SCENE...]: which of a
# frame's reads the caches hold, by tracing range and by the order of tiles. Prints one table in Markdown.
# There need be no counters: cachegrind simulates one core's caches (48 KiB and 1 MiB). Each setting of
# bench_thesis runs with one frame and with 1 + N (2): the difference is what N frames read, without what sets
# them up. One worker, one direct and two bounce rays a texel, D texels a metre (2).
# Default scenes: builtin:atrium-matt. Wants valgrind; takes minutes (Cornell) to an hour.
set -euo pipefail
. "$(dirname "$0")/served.bash" # bin, run
frames=2 density=2 l1=49152,12,64 l2=1048576,16,64
while [ $# -gt 1 ]; do
    case $1 in
    --frames) frames=$2 ;;
    --density) density=$2 ;;
    --l1) l1=$2 ;;
    --l2) l2=$2 ;;
    *) break ;;
    esac
    shift 2
done
[ $# -gt 0 ] || set -- builtin:atrium-matt
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# reads SCENE QUESTION SETTING FRAMES: data reads, of which the first level lacked, of which the second
reads() {
    run "$work/log" valgrind --tool=cachegrind --cache-sim=yes --D1="$l1" --LL="$l2" \
        --cachegrind-out-file="$work/out" "$bin/bench_thesis" --question "$2" --only "$3" --frames "$4" \
        --texels-per-metre "$density" "$1"
    awk '/^summary:/ { print $5, $6, $7 }' "$work/out"
}

echo "| scene | setting | reads a frame, M | first level holds | second level holds of the rest |" \
    "all the way to memory, M |"
echo "|---|---|---|---|---|---|"
for scene in "$@"; do
    for setting in "range inf" "range 1" "range 0.4" "range 0.1" "range 0" "order object" "order none"; do
        read -r question name <<<"$setting"
        short=$(reads "$scene" "$question" "$name" 1)
        long=$(reads "$scene" "$question" "$name" $((1 + frames)))
        echo "$short $long" | awk -v n="$frames" -v s="$(basename "$scene")" -v q="$question $name" '{
            r = ($4 - $1) / n; l1 = ($5 - $2) / n; l2 = ($6 - $3) / n
            printf "| %s | %s | %.1f | %.2f %% | %.1f %% | %.3f |\n",
                s, q, r / 1e6, 100 * (1 - l1 / r), 100 * (1 - l2 / l1), l2 / 1e6 }'
    done
done
