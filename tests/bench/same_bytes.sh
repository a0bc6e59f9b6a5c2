#!/bin/bash
# same_bytes.sh OLD NEW [SCENE...]: do two builds give the same light, byte for byte? OLD and NEW are folders of
# programs (build/release/bin). Of each scene: the lightmaps of a bake (.exr), and sixteen frames of it while it moves,
# as the server keeps them: tiles as they go over the wire, and sums. Views are made of these alone. Prints a line for
# each part and ends with 1 if anything differs. Some minutes.
set -euo pipefail
[ $# -ge 2 ] || { sed -n '2,5s/^# //p' "$0" >&2; exit 64; }
old=$1 new=$2
shift 2
scenes=("$@")
[ ${#scenes[@]} -gt 0 ] || scenes=(builtin:cornell builtin:atrium builtin:city:2)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
failed=0

# light BIN SCENE OUT: makes OUT/bake/*.exr and OUT/keep/*
light() {
    mkdir -p "$3/keep"
    "$1/lightwell-bake" "$2" -o "$3/bake" --samples 4 --denoise --texels-per-metre 2 >"$3/bake.log" 2>&1
    for _ in $(seq 16); do echo; done | timeout 600 "$1/lightwelld" "$2" --clock manual --light whole --texels-per-metre 2 \
        --keep "$3/keep" --listen 127.0.0.1:0 >"$3/server.log" 2>&1
}

# count_differences PART FILE: how many bytes of it differ
count_differences() { cmp -l "$folder/old/$1/$2" "$folder/new/$1/$2" 2>&1 | wc -l; }

for scene in "${scenes[@]}"; do
    rm -rf "$folder"/{old,new}
    light "$old" "$scene" "$folder/old"
    light "$new" "$scene" "$folder/new"
    for part in bake keep; do
        files=$(find "$folder/new/$part" -type f ! -name '*.json' -printf '%P\n')
        # what is kept names its run: a number, a time, the key of its options and their checksums
        allowed=$([ $part = keep ] && echo 48 || echo 0)
        differ=0
        for file in $files; do
            [ "$(count_differences $part "$file" || true)" -le "$allowed" ] || differ=$((differ + 1))
        done
        echo "$scene: $part: $(wc -w <<<"$files") files, $differ differ"
        [ -n "$files" ] && [ $differ -eq 0 ] || failed=1
    done
done
exit $failed
