#!/bin/sh
# baked_blender.sh SOURCE BIN FOLDER: a baked .glb in Blender's Cycles against our path tracer: means within
# 3 %. The scene is that of client/web/test/baked.test.mjs, whose box and shelf show their double-sided backs;
# as it is baked by default, and with split sides. Then a wall with a normal map, by baked directions of each form:
# under a lamp by our own form, and under an even sky by all of them, which are exact there. Pictures stay in FOLDER.
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

node --input-type=module -e "
import { writeFileSync } from 'node:fs';
import { bentWall } from '$source/client/web/test/bent_wall.mjs';
writeFileSync('wall.gltf', bentWall());
writeFileSync('sky.gltf', bentWall({ lamp: false }));"
wall=1.2,0.1,-2.6:2,1,-3:36 # it fills the picture: Blender has no sky here
for case in wall:own sky:own sky:dominant sky:sh; do
    scene=${case%:*} form=${case#*:} sky=0,0,0
    [ $scene = wall ] || sky=1,2,3
    "$bin/lightwell-view" --path-trace $scene.gltf --spp 256 --bounces 0 --camera $wall --size 240x135 --sky $sky \
        --out ours-$scene.exr
    "$bin/lightwell-bake" $scene.gltf -o maps-$scene-$form --restart --texels-per-metre 24 --samples 256 --bounces 0 \
        --direction-form $form --gltf-out $scene-$form.glb --sky $sky
    blender --background --factory-startup --python-exit-code 2 \
        --python "$source/tests/bench/baked_blender.py" -- $scene-$form.glb --out $scene-$form.png --camera $wall \
        --size 240x135 --reference ours-$scene.exr > $scene-$form.log 2>&1 ||
        { tail -20 $scene-$form.log; exit 1; }
    echo "$scene, $form: $(grep 'means of' $scene-$form.log)"
done
