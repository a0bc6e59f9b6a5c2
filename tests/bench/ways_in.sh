#!/bin/bash
# ways_in.sh PREFIX FOLDER: tries each way to the light from what is installed below PREFIX, as somebody would who has just
# installed it, and leaves a picture of each in FOLDER, and all beside one another in FOLDER/ways_in.png.
#     cmake --install build/release --prefix PREFIX && tests/bench/ways_in.sh PREFIX FOLDER
# Wants Xvfb, ImageMagick, Chromium, node and the npm packages of client/web. Windows are looked at 1.5 and 13 seconds
# after they were started. A way that shows nothing ends it with a line.
set -euo pipefail
[ $# -eq 2 ] || { sed -n '2,6s/^# //p' "$0"; exit 64; }
prefix=$(realpath "$1") folder=$(realpath -m "$2")
source=$(cd "$(dirname "$0")/../.." && pwd)
mkdir -p "$folder"
export LD_LIBRARY_PATH=$prefix/lib PKG_CONFIG_PATH=$prefix/lib/pkgconfig XDG_CONFIG_HOME=$folder XDG_CACHE_HOME=$folder
size=640x360
started=()
finish() {
    for process in "${started[@]}"; do kill "$process" 2>/dev/null || true; done
    wait
}
trap finish EXIT

die() { echo "ways_in.sh: $1" >&2; exit 1; }
# until_file FILE: waits until it is there and holds something
until_file() {
    for _ in $(seq 1800); do
        [ ! -s "$1" ] || return 0
        sleep 0.1
    done
    die "$1 does not come"
}
# seen NAME: dies if the picture has one colour
seen() {
    local deviation
    deviation=$(convert "$folder/$1.png" -colorspace gray -format '%[fx:1000*standard_deviation]' info:)
    [ "${deviation%.*}" -ge 20 ] || die "$1 shows nothing"
    echo "$1.png"
}
# window NAME ARGUMENTS...: a window, 1.5 and 13 seconds after its program was started
window() {
    local name=$1 number
    shift
    Xvfb -displayfd 3 -screen 0 "${size}x24" -nolisten tcp 3>"$folder/display" 2>/dev/null &
    local display=$!
    started+=("$display")
    until_file "$folder/display"
    number=$(cat "$folder/display")
    DISPLAY=:$number "$prefix/bin/lightwell-view" "$@" --size "$size" >"$folder/$name.log" 2>&1 &
    local view=$!
    started+=("$view")
    sleep 1.5
    import -display ":$number" -window root "$folder/${name}_begins.png"
    sleep 11.5
    import -display ":$number" -window root "$folder/$name.png"
    kill "$view" && { wait "$view" || true; }
    kill "$display" && { wait "$display" || true; }
    rm "$folder/display"
    seen "$name"
}

rm -f "$folder/port" "$folder/page"
"$prefix/bin/lightwelld" builtin:atrium-matt --freeze 3 --listen 127.0.0.1:0 --http 127.0.0.1:0 --port-file "$folder/port" \
    >"$folder/lightwelld.out" 2>"$folder/lightwelld.err" &
started+=($!)
until_file "$folder/port"
server=127.0.0.1:$(cat "$folder/port")
page=$(grep -ohE 'https?://127\.0\.0\.1:[0-9]+/' "$folder"/lightwelld.{out,err} | head -n 1)

for renderer in cpu gl; do
    "$prefix/bin/lightwell-view" "$server" --headless --renderer "$renderer" --size "$size" \
        --out "$folder/headless_$renderer.png" >"$folder/headless_$renderer.log" 2>&1
    seen "headless_$renderer"
done
window window_cpu "$server" --renderer cpu
window window_gl "$server" --renderer gl

cc "$prefix/share/doc/lightwell/examples/minimal.c" -o "$folder/minimal" $(pkg-config --cflags --libs lightwell)
timeout 30 "$folder/minimal" "${server#*:}" 0 6 0 >"$folder/minimal.log" 2>&1 || true # until it is stopped
grep -q 'W/m^2' "$folder/minimal.log" || die "minimal: $(cat "$folder/minimal.log")"
convert -background '#202020' -fill white -pointsize 22 -gravity center -size "$size" \
    label:"$(head -n 7 "$folder/minimal.log")" +set label "$folder/minimal.png"
c++ -std=c++17 "$prefix/share/doc/lightwell/examples/gl_lightmap.cpp" -o "$folder/gl_lightmap" \
    $(pkg-config --cflags --libs lightwell epoxy egl)
"$folder/gl_lightmap" "${server#*:}" "$folder/gl_lightmap.ppm" >"$folder/gl_lightmap.log" 2>&1
convert "$folder/gl_lightmap.ppm" -resize "$size" "$folder/gl_lightmap.png"
rm "$folder/gl_lightmap.ppm"
seen gl_lightmap

node "$source/client/web/test/ways_in.mjs" page "$page" "$folder/page.png"
seen page
LW_BIN=$prefix/bin node "$source/client/web/test/ways_in.mjs" three "$prefix/share/lightwell/lightwell-three" \
    "$folder/three.png"
seen three

# a scene file alone: the window begins a server of its own
"$prefix/bin/lightwell-bake" builtin:cornell -o "$folder/maps" --samples 16 --gltf-out "$folder/cornell.glb" \
    >"$folder/bake.log" 2>&1
window scene_file "$folder/cornell.glb"

cd "$folder"
montage -label 'lightwell-view, after 1.5 s' window_cpu_begins.png -label 'after 13 s, by rays' window_cpu.png \
    -label 'after 13 s, --renderer gl' window_gl.png -label 'lightwell-view cornell.glb' scene_file.png \
    -label 'lightwell-view --headless' headless_cpu.png -label '--headless --renderer gl' headless_gl.png \
    -label 'the page, Chromium' page.png -label 'lightwell-three, example.html' three.png \
    -label 'examples/gl_lightmap.cpp' gl_lightmap.png -label 'examples/minimal.c' minimal.png \
    -tile 3x -geometry 426x240+4+4 -depth 8 -strip ways_in.png
echo ways_in.png
