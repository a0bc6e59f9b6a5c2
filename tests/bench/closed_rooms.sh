#!/bin/bash
# closed_rooms.sh [--seconds S] [THICK...]: what light passes the walls of a closed house (closed_house.py) whose
# floor goes on out of doors under a sun of 5 kW/m^2. Prints one table in Markdown.
# E inside, W/m^2 (pi x radiance over 0.7 of albedo), mean over a picture from above, which sees the floor and
# all walls: by paths; live, S seconds (10) after a client has joined, without the sun and with it; 3 s after
# the sun was switched off and on; 3 s after a wall that was taken away has been put back; 3 s after the lamp was
# then dimmed to a quarter, times four. THICK: walls, m (0.02 0.1 0.3 1).
set -euo pipefail
. "$(dirname "$0")/served.bash"
seconds=10
if [ "${1:-}" = --seconds ]; then seconds=$2; shift 2; fi
[ $# -gt 0 ] || set -- 0.02 0.1 0.3 1
work=$(mktemp -d)
trap 'stop_serving; rm -rf "$work"' EXIT
camera=0.1,2.9,0.1:0,0,0:110

# mean_inside VIEWER-OPTION...: mean radiance of the picture
mean_inside() {
    "$bin/lightwell-view" --camera "$camera" --size 320x180 --json --out "$work/view.exr" "$@" 2>"$work/log" |
        grep -oE '"mean_rgb": *\[[0-9.e+-]*' | grep -oE '[0-9.e+-]*$' || { cat "$work/log" >&2; exit 1; }
}
live() { mean_inside --headless "$address" --wait "seconds:$1"; }
change() { run "$work/log" "$bin/lightwellctl" "unix:$work/control.sock" "$@"; }

echo "| walls, m | paths | no sun | sun | it came 3 s ago | a wall came 3 s ago | lamp dimmed 3 s ago, x 4 |"
echo "|---|---|---|---|---|---|---|"
for thick in "$@"; do
    for sun in 0 5000; do
        python3 "$(dirname "$0")/closed_house.py" "$thick" 0.3 "$sun" >"$work/$sun.gltf"
    done
    paths=$(mean_inside --path-trace "$work/5000.gltf" --spp 256)
    serve "$work" "$work/0.gltf"
    without=$(live "$seconds")
    stop_serving
    serve "$work" "$work/5000.gltf" --control-socket "$work/control.sock"
    with=$(live "$seconds")
    change light sun off
    live 3 >/dev/null
    change light sun on
    came=$(live 3)
    change hide west
    live 3 >/dev/null
    change show west
    wall=$(live 3)
    change light lamp intensity 10 10 10
    dimmed=$(live 3)
    stop_serving
    echo "$thick $paths $without $with $came $wall $dimmed" | awk '{ e = atan2(0, -1) / 0.7
        printf "| %s | %.2f | %.2f | %.2f | %.2f | %.2f | %.2f |\n", $1, e * $2, e * $3, e * $4, e * $5, e * $6,
            4 * e * $7 }'
done
