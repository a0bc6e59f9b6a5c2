#!/bin/bash
# Runs examples/ on a lightwelld of their own: examples.sh LIGHTWELLD MINIMAL GL_LIGHTMAP FOLDER
set -euo pipefail
daemon_program=$1 minimal=$2 gl_lightmap=$3 folder=$4
mkdir -p "$folder"
rm -f "$folder"/*
"$daemon_program" builtin:atrium --texels-per-metre 4 --bounces 1 --error 1e-6 --client-lights none \
    --listen 127.0.0.1:0 --port-file "$folder/port" >"$folder/out" 2>"$folder/err" &
daemon=$!
trap 'kill $daemon; wait $daemon || true' EXIT
for ((i = 0; i < 1200; i++)); do
    [ -s "$folder/port" ] && break
    sleep 0.1
done
port=$(cat "$folder/port")

# Light at a point, three times different.
timeout 200 "$minimal" "$port" 0 6 0 | head -4 >"$folder/minimal" || true
cat "$folder/minimal"
[ "$(grep -c 'W/m^2' "$folder/minimal")" -eq 3 ] || exit 1
[ "$(sort -u "$folder/minimal" | wc -l)" -eq 4 ] || exit 1

# A picture that is lit: some of it bright, some dark, most in between.
timeout 200 "$gl_lightmap" "$port" "$folder/atrium.ppm" 3
od -An -v -t u1 -w3 -j 16 "$folder/atrium.ppm" | awk '
    { g = $2; dark += g < 8; bright += g > 247; n++ }
    END { printf "%d pixels, %.3f dark, %.3f bright\n", n, dark / n, bright / n
          exit !(n == 1280 * 720 && dark / n < 0.2 && bright / n < 0.4 && dark + bright < n / 2) }'
