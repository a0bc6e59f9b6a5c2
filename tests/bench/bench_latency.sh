#!/bin/bash
# bench_latency.sh BENCH: a short run of bench_latency in a Cornell box, the same from kept light, and from light that is not what it was.
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
    if update --truth "$work/truth"; then fail "took light from a file that $2"; fi
    grep -q "$1.*$2" "$work/err" || fail "said of a file that $2: $(cat "$work/err")"
}

update --truth "$work/truth"
grep -q 'undone | [1-9]' "$work/out" || fail "no tile after an update: $(cat "$work/out")"
files=("$work"/truth/*.fresh)
[ ${#files[@]} = 4 ] || fail "${#files[@]} files of two states by two seeds"
kept=$(stat -c '%n %i %y' "${files[@]}")
update --truth "$work/truth"
[ "$(stat -c '%n %i %y' "$work"/truth/*)" = "$kept" ] || fail "kept light was not read but written anew"
grep -q 'agreement 1.00' "$work/out" || fail "light was kept as something else: $(cat "$work/out")"

cp "${files[0]}" "$work/whole"
cp "${files[1]}" "${files[0]}"
refused "${files[0]}" "holds the light of something else"
head -c 100 "$work/whole" >"${files[0]}"
refused "${files[0]}" "is damaged or cut short"
: >"${files[0]}"
refused "${files[0]}" "holds no fresh light"
