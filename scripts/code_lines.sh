#!/bin/bash
# Counts lines of C code, room by room: no comments, no blank lines, no assertions.
#
#   scripts/code_lines.sh [COMMIT] [FOLDER...]
#
# COMMIT  default: HEAD
# FOLDER  default: client server common relay proto tests/bench; each is counted with the folders below it
set -euo pipefail
cd "$(dirname "$0")/.."
commit=${1:-HEAD}
shift || true
[ $# -gt 0 ] || set -- client server common relay proto tests/bench

for folder in "$@"; do
    git ls-tree -r --name-only "$commit" -- "$folder/" | { grep '\.[ch]$' || true; } |
        while read -r file; do git show "$commit:$file"; done |
        perl -0777 -pe '
            s{("(?:[^"\\\n]|\\.)*"|\x27(?:[^\x27\\\n]|\\.)*\x27)|/\*.*?\*/|//[^\n]*}{$1 // " "}gse;
            s/^\s*(?:LW_INVARIANT\w*|(?:_Static_|static_)?assert)\b\s*(\((?:[^()]++|(?1))*\))\s*;//gm' |
        awk -v folder="$folder" 'NF { lines++ } END { printf "%7d  %s\n", lines, folder }'
done
