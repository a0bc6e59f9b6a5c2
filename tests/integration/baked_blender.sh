#!/bin/sh
# baked_blender.sh SOURCE BIN FOLDER: a baked .glb in Blender's Cycles against our path tracer: means within
# 3 %. The scene is that of client/web/test/baked.test.mjs, whose box and shelf show their double-sided backs;
# as it is baked by default, and with split sides. Pictures stay in FOLDER.
set -eu
source=$1 bin=$2 folder=$3
for program in blender node; do
    command -v $program > /dev/null || { echo "skipped: there is no $program"; exit 0; }
done
blender --background --factory-startup --python-exit-code 2 --python-expr 'import numpy' > /dev/null 2>&1 ||
    { echo "skipped: Blender's glTF importer wants numpy"; exit 0; }
mkdir -p "$folder"
cd "$folder"
camera=1.5,1.7,2.2:-0.2,1,-1:60
node --input-type=module -e "
import { writeFileSync } from 'node:fs';
import { room } from '$source/client/web/test/room.mjs';
writeFileSync('room.gltf', room({ turned: true }));"
"$bin/lightwell-view" --path-trace room.gltf --spp 64 --bounces 4 --camera $camera --size 480x270 \
    --out ours.exr
for name in lit split; do
    more=
    [ $name = lit ] || more=--gltf-split-sides
    "$bin/lightwell-bake" room.gltf -o maps-$name --restart --texels-per-metre 24 --samples 64 --bounces 4 \
        --denoise --gltf-out $name.glb $more
    blender --background --factory-startup --python-exit-code 2 \
        --python "$source/tests/bench/baked_blender.py" -- $name.glb --out $name.png --camera $camera \
        --reference ours.exr > $name.log 2>&1 ||
        { tail -20 $name.log; exit 1; }
    grep 'means of' $name.log # it was there: else the script had ended before
done
