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
[ ${#scenes[@]} -gt 0 ] || scenes=(builtin:cornell builtin:atrium-matt builtin:city:2)
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

# differs PART FILE: whether its light does. What is kept begins with its run (a number, a time, the key of its
# options: of a length that varies by a few bytes), within 1,408 bytes, and ends with a checksum of 8: light is
# between them.
differs() {
    local size_old size_new size
    size_old=$(wc -c <"$folder/old/$1/$2") size_new=$(wc -c <"$folder/new/$1/$2")
    if [ "$1" = bake ]; then
        if cmp -s "$folder/old/$1/$2" "$folder/new/$1/$2"; then return 1; else return 0; fi
    fi
    # Aligned at the end.
    size=$(((size_old < size_new ? size_old : size_new) - 1408))
    [ $((size_old - size_new)) -gt 8 ] || [ $((size_new - size_old)) -gt 8 ] || [ $size -le 0 ] ||
        ! cmp -s <(tail -c "$size" "$folder/old/$1/$2" | head -c -8) \
            <(tail -c "$size" "$folder/new/$1/$2" | head -c -8)
}

for scene in "${scenes[@]}"; do
    rm -rf "$folder"/{old,new}
    light "$old" "$scene" "$folder/old"
    light "$new" "$scene" "$folder/new"
    for part in bake keep; do
        files=$(find "$folder/new/$part" -type f ! -name '*.json' -printf '%P\n')
        differ=0
        for file in $files; do
            ! differs $part "$file" || differ=$((differ + 1))
        done
        echo "$scene: $part: $(wc -w <<<"$files") files, $differ differ"
        [ -n "$files" ] && [ $differ -eq 0 ] || failed=1
    done
done
exit $failed
