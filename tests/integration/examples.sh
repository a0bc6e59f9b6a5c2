#!/bin/bash
# Runs examples/ on a lightwelld of their own, whose frames come when they are asked for:
#     examples.sh LIGHTWELLD FOLDER MINIMAL FINER GL_LIGHTMAP [MINIMAL FINER GL_LIGHTMAP...]
set -euo pipefail
daemon_program=$1 folder=$2
shift 2
limit=480 # seconds; ends what hangs, and judges nothing
mkdir -p "$folder"
rm -f "$folder"/*

coproc daemon {
    exec "$daemon_program" builtin:cornell --error 1e-6 --client-lights none \
        --clock manual --listen 127.0.0.1:0 2>&1
}
pid=$daemon_PID frames=${daemon[1]}
trap 'kill $pid; wait $pid || true' EXIT
port=
while [ -z "$port" ] && read -r -t $limit line <&"${daemon[0]}"; do
    echo "$line" >>"$folder/log"
    port=$(sed -n 's/.*serving .* at 127\.0\.0\.1:\([0-9]*\).*/\1/p' <<<"$line")
done
[ -n "$port" ] || { cat "$folder/log"; exit 1; }

# next_line SECONDS: reads a line of the client into `line`; false if none is whole by then. The part that has
# come is kept.
part=
next_line() {
    if read -r -t "$1" line <&"$told"; then
        line=$part$line part=
        return 0
    fi
    part+=$line
    return 1
}

# Light at a point, three times different. A frame that changes nothing there says nothing: then the next one.
light_at_a_point() {
    local line lines=0
    part=
    exec {told}< <(exec timeout $limit "$1" "$port" 0 1 0)
    local client=$!
    while [ $lines -lt 4 ]; do
        echo >&"$frames"
        if next_line 1; then
            echo "$line"
            lines=$((lines + 1))
        else
            kill -0 $client || exit 1
        fi
    done
    kill $client
    exec {told}<&-
}

# A picture that is lit: beside the box all is black, 0.43 of it; within, little is dark, or as bright as its lamp.
lit_picture() {
    timeout $limit "$1" "$port" "$folder/cornell.ppm" 1
    od -An -v -t u1 -w3 -j 16 "$folder/cornell.ppm" | awk '
        { dark += $1 < 8 && $2 < 8; bright += $2 > 247; n++ }
        END { printf "%d pixels, %.3f dark, %.3f bright\n", n, dark / n, bright / n
              exit !(n == 1280 * 720 && dark / n > 0.4 && dark / n < 0.55 && bright / n < 0.05) }'
}

# Tiles of finer levels come, are shown and go, while frames are made.
finer_tiles() {
    local line
    part=
    exec {told}< <(exec timeout $limit "$1" "$port" 2)
    local client=$!
    while kill -0 $client 2>/dev/null; do
        printf '\n\n\n\n' >&"$frames"
        while next_line 0.05; do echo "$line"; done
    done
    printf '%s' "$part" # and its last lines
    cat <&"$told"
    exec {told}<&-
}

finer=()
while [ $# -gt 0 ]; do
    light_at_a_point "$1" >"$folder/minimal"
    cat "$folder/minimal"
    [ "$(grep -c 'W/m^2' "$folder/minimal")" -eq 3 ]
    [ "$(sed 's/.* s //' "$folder/minimal" | sort -u | wc -l)" -eq 4 ]
    finer+=("$2")
    lit_picture "$3"
    shift 3
done
# last, for they take many frames, and light hardly changes after these
for program in "${finer[@]}"; do
    finer_tiles "$program" >"$folder/finer"
    cat "$folder/finer"
    [ "$(grep -c ' times finer, .*: shown$' "$folder/finer")" -ge 2 ]
    [ "$(grep -c ': texels$' "$folder/finer")" -eq "$(grep -c ': gone$' "$folder/finer")" ]
done
