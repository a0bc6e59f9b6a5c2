#!/bin/bash
# bench_latency.sh BENCH: a short run of bench_latency in a Cornell box, the same from kept light, and from light that is not what it was;
# a lamp that walks over a floor, and what has no animation.
set -euo pipefail
bench=$1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

fail() {
    echo "bench_latency.sh: $1" >&2
    exit 1
}

# update ANY...: the lamp is dimmed, and lit again
update() {
    "$bench" --updates 2 --settle 0.2 --frames 2 --fresh 4 --daemon "--texels-per-metre 6" "$@" builtin:cornell \
        "main material lamp emission 5 5 5" >"$work/out" 2>"$work/err"
}

# refused FILE WHY: the next update takes no light from it
refused() {
    if update --reference "$work/reference"; then fail "took light from a file that $2"; fi
    grep -q "$1.*$2" "$work/err" || fail "said of a file that $2: $(cat "$work/err")"
}

update --reference "$work/reference"
grep -q 'undone | [1-9]' "$work/out" || fail "no tile after an update: $(cat "$work/out")"
files=("$work"/reference/*.fresh)
[ ${#files[@]} = 4 ] || fail "${#files[@]} files of two states by two seeds"
kept=$(stat -c '%n %i %y' "${files[@]}")
update --reference "$work/reference"
[ "$(stat -c '%n %i %y' "$work"/reference/*)" = "$kept" ] || fail "kept light was not read but written again"
grep -q 'agreement 1.00' "$work/out" || fail "light was kept as something else: $(cat "$work/out")"

cp "${files[0]}" "$work/whole"
cp "${files[1]}" "${files[0]}"
refused "${files[0]}" "holds the light of something else"
head -c 100 "$work/whole" >"${files[0]}"
refused "${files[0]}" "is damaged or cut short"
: >"${files[0]}"
refused "${files[0]}" "holds no fresh light"

# A lamp of 0.6 m goes from -1.5 m to 1.5 m and back in 2 s, 1 m above a floor. In the buffer: a square, its two triangles, three times, three places.
cat >"$work/walk.gltf" <<'END'
{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
 "nodes": [{"mesh": 0, "scale": [3, 1, 2]}, {"mesh": 1, "rotation": [1, 0, 0, 0], "scale": [0.3, 1, 0.3]}],
 "materials": [{}, {"emissiveFactor": [1, 1, 1]}],
 "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]},
            {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 1}]}],
 "animations": [{"samplers": [{"input": 2, "output": 3}],
                 "channels": [{"sampler": 0, "target": {"node": 1, "path": "translation"}}]}],
 "accessors": [
  {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-1, 0, -1], "max": [1, 0, 1]},
  {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
  {"bufferView": 2, "componentType": 5126, "count": 3, "type": "SCALAR", "min": [0], "max": [2]},
  {"bufferView": 3, "componentType": 5126, "count": 3, "type": "VEC3"}],
 "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12},
                 {"buffer": 0, "byteOffset": 60, "byteLength": 12}, {"buffer": 0, "byteOffset": 72, "byteLength": 36}],
 "buffers": [{"byteLength": 108, "uri": "data:application/octet-stream;base64,AACAvwAAAAAAAIC/AACAvwAAAAAAAIA/AACAPwAAAAAAAIA/AACAPwAAAAAAAIC/AAABAAIAAAACAAMAAAAAAAAAgD8AAABAAADAvwAAgD8AAAAAAADAPwAAgD8AAAAAAADAvwAAgD8AAAAA"}]}
END

# walk SCENE CAMERA ANY...
walk() {
    "$bench" --walk --settle 0.2 --frames 2 --fresh 4 --daemon "--texels-per-metre 8" "$@" >"$work/out" 2>"$work/err"
}

walk "$work/walk.gltf" 0,4,4:0,0,0:50 --times 0.25,0.75 --updates 3 || fail "walk: $(cat "$work/err")"
[ "$(grep -c '^| 0.[27]5 | [123] |' "$work/out")" = 6 ] || fail "not two times in three passes: $(cat "$work/out")"
awk -F'|' '/median/ { medians = 1; next } medians && /0.[27]5/ { n++; if ($3 < 0.5 || $5 > 0.5 || $6 > 0.5 || $7 < 0.9) exit 1 } END { exit n != 2 }' \
    "$work/out" || fail "a floor whose whole light takes a millisecond trails behind: $(cat "$work/out")"

# unwalkable WHY ANY...: walk ANY... ends with that error
unwalkable() {
    local why=$1
    shift
    if walk "$@"; then fail "walked: $*"; fi
    grep -q -- "$why" "$work/err" || fail "said of $*: $(cat "$work/err")"
}

unwalkable "cornell: has no animation" builtin:cornell main
unwalkable "nothing but noise" "$work/walk.gltf" 0,4,4:0,0,0:50 --times 0.5 # where it was a second before
unwalkable "0 to 2 s, which 9 is not in" "$work/walk.gltf" 0,4,4:0,0,0:50 --times 0.5,9
unwalkable "not 'x'" "$work/walk.gltf" 0,4,4:0,0,0:50 --times 1,x
unwalkable "no camera \"lamp\"" "$work/walk.gltf" lamp --times 1
unwalkable "a scene and a camera" "$work/walk.gltf"
sed 's/{"mesh": 1,/{"mesh": 1, "camera": 0,/; s/^ "materials"/ "cameras": [{"type": "perspective", "name": "rider", "perspective": {"yfov": 1, "znear": 0.1}}],\n&/' \
    "$work/walk.gltf" >"$work/rider.gltf"
unwalkable "camera \"rider\" moves" "$work/rider.gltf" rider --times 1
