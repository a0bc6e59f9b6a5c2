#!/bin/bash
# side_by_side.sh FOLDER SCENE[@CAMERA]+WxH+X+Y[+WxH+X+Y...]...: what somebody sees at his default settings, beside what he
# would see without a server. Parts of a picture of 640 x 360 (W x H pixels at X, Y), above: tiles with all light; tiles under
# direct light drawn at pixels. Below: one path a pixel and SVGF (bench_renderers), eight frames of it; 256 paths a pixel. All
# of a scene at one exposure, held still; both pictures of the server's a minute after the client has joined. Leaves them in
# FOLDER, and all parts in FOLDER/side_by_side.png. Wants ImageMagick.
set -euo pipefail
[ $# -ge 2 ] || { sed -n '2,6s/^# //p' "$0"; exit 64; }
. "$(dirname "$0")/served.bash"
folder=$(realpath -m "$1")
shift
mkdir -p "$folder"
width=640 height=360
trap stop_serving EXIT

# look WHAT: a picture of a client that has just joined
look() {
    run "$folder/log" "$bin/lightwell-view" --headless "$address" --direct "$1" --wait seconds:60 \
        --timeout 600 ${camera:+--camera-name "$camera"} --size "${width}x$height" --samples-per-pixel 8 \
        --exposure "$stops" --out "$folder/$name-$1.png"
}

rows=()
for argument in "$@"; do
    IFS=+ read -r -a part <<<"$argument"
    scene=${part[0]%@*} camera=
    [ "$scene" = "${part[0]}" ] || camera=${part[0]#*@}
    name=$(basename "$scene")
    [ ${#part[@]} -ge 4 ] || { echo "side_by_side.sh: $argument: +WxH+X+Y is missing" >&2; exit 64; }
    run "$folder/$name.md" "$bin/bench_renderers" --width "$width" --height "$height" --reference 256 --frames 8 --spp-max 1 \
        --renderers svgf --motion all --step 0 --move 0 --turn 0 -o "$folder" "${part[0]}"
    stops=$(sed -n 's/.*pictures at exposure //p' "$folder/$name.md")
    serve "$folder" "$scene" --freeze 0 >/dev/null
    look tiles
    look auto
    stop_serving
    for ((p = 1; p < ${#part[@]}; p += 3)); do
        row=$folder/$name-part$p.png
        for picture in tiles auto svgf-1 reference-256; do
            convert "$folder/$name-$picture.png" -crop "${part[p]}+${part[p + 1]}+${part[p + 2]}" +repage \
                -filter point -resize 500x "$folder/part-$picture.png"
        done
        montage "$folder"/part-{tiles,auto,svgf-1,reference-256}.png -tile 2x2 -geometry +0+0 "$row"
        rows+=("$row")
    done
done
convert "${rows[@]}" -append -colors 255 "$folder/side_by_side.png"
echo "$folder/side_by_side.png"
