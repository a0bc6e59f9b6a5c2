#!/bin/bash
# relays.sh BIN SCENE [USERS...]: what walking users cost a daemon by themselves and through three relays, and the relays. A row
# for each number of users (default 50 200): CPU seconds a second, by the stages that the programs tell of themselves.
# LW_RELAYS_SECONDS (default 20): how long each is measured. LW_RELAYS_DAEMON: further options of the daemon. With
# "--light whole" its work does not follow what users look at. LW_RELAYS_REST=N, in place of rows: N users of a
# scene at rest, and what they take.
set -euo pipefail
bin=$1 scene=$2
shift 2
[ $# -gt 0 ] || set -- 50 200
seconds=${LW_RELAYS_SECONDS:-20}
work=$(mktemp -d)
pids=()
trap 'kill "${pids[@]}" 2>/dev/null || true; wait; rm -rf "$work"' EXIT
export OMP_WAIT_POLICY=passive XDG_CACHE_HOME=$work/cache LIGHTWELL_LOG_FORMAT=text

# start NAME PROGRAM ARGUMENTS...
start() {
    local name=$1 program=$2
    shift 2
    "$bin/$program" "$@" --listen 127.0.0.1:0 --port-file "$work/$name" --http none --control-socket none \
        --metrics 127.0.0.1:0 --metrics-port-file "$work/$name.metrics" 2>"$work/$name.log" &
    pids+=($!)
    until [ -s "$work/$name" ]; do
        kill -0 $! || { cat "$work/$name.log" && exit 1; }
        sleep 0.1
    done
}
port() { cat "$work/$1"; }
figure() { # NAME METRIC
    curl -s "http://127.0.0.1:$(port "$1.metrics")/metrics" | awk -v name="$2" '$1 == name { print $2 }'
}
cpu() { figure "$1" "lightwell_cpu_seconds_total{stage=\"$2\"}"; }

# total METRIC: of the three relays
total() {
    local n
    for n in relay1 relay2 relay3; do figure $n "$1"; done | awk '{ sum += $1 } END { print sum }'
}

# what all of them have used so far, on one line
figures() {
    echo "$(cpu daemon solve) $(cpu daemon publish) $(cpu daemon serve) $(figure daemon lightwell_sent_bytes_total)" \
        "$(total 'lightwell_cpu_seconds_total{stage="relay"}') $(total 'lightwell_cpu_seconds_total{stage="serve"}')" \
        "$(total lightwell_sent_bytes_total) $EPOCHREALTIME"
}

# measure USERS PORT...: users in equal shares at these ports; prints a row's end
measure() {
    local users=$1 share before loads=() p l
    shift
    share=$((users / $#))
    for p in "$@"; do
        "$bin/lightwell-load" "127.0.0.1:$p" --users $share --seconds $((seconds + 12)) --ramp $((share / 5 + 10)) \
            --path walk --json >"$work/load.$p" 2>"$work/load.$p.log" &
        loads+=($!)
    done
    sleep 8 # all have joined
    before=$(figures)
    sleep "$seconds"
    echo "$before $(figures)" | awk '{
        t = $16 - $8
        printf "%.4f | %.4f | %.4f | %.2f | %.4f | %.4f | %.2f |", ($9 - $1) / t, ($10 - $2) / t, ($11 - $3) / t,
            8e-6 * ($12 - $4) / t, ($13 - $5) / t, ($14 - $6) / t, 8e-6 * ($15 - $7) / t }'
    for l in "${loads[@]}"; do wait "$l" || true; done
}

# rest USERS: at the three relays; memory of a session, and processor time of all, while nothing changes
rest() {
    local n p before after loads=() share=$(($1 / 3))
    work_of_all() {
        echo "$(total 'lightwell_cpu_seconds_total{stage="relay"}') $(total 'lightwell_cpu_seconds_total{stage="serve"}')"
    }
    before=$(total process_resident_memory_bytes)
    for n in 1 2 3; do
        "$bin/lightwell-load" "127.0.0.1:$(port relay$n)" --users $share --seconds 40 --ramp 400 --path still --json \
            >"$work/load.$n" 2>"$work/load.$n.log" &
        loads+=($!)
    done
    until [ "$(total lightwell_sessions)" -ge $((3 * share)) ]; do sleep 1; done
    sleep 10 # all have their view
    after=$(total process_resident_memory_bytes)
    read -r relay serve < <(work_of_all)
    sleep 10
    echo "$((3 * share)) $before $after $relay $serve $(work_of_all)" | awk '{
        printf "%d sessions at rest: %.1f KB each, %.3f of a core for all\n", $1, ($3 - $2) / $1 / 1000, ($6 + $7 - $4 - $5) / 10 }'
    for p in "${loads[@]}"; do wait "$p" || true; done
}

read -r -a more <<<"${LW_RELAYS_DAEMON:-}"
[ -z "${LW_RELAYS_REST:-}" ] || more+=(--freeze 0)
start daemon lightwelld "$scene" --threads 1 --frame-rate 10 "${more[@]}"
for n in 1 2 3; do start relay$n lightwell-relay "127.0.0.1:$(port daemon)"; done
if [ -n "${LW_RELAYS_REST:-}" ]; then
    rest "$LW_RELAYS_REST"
    exit
fi
echo '| users | at | daemon: solve | publish | serve | Mbit/s | relays: light | serve | Mbit/s |'
echo '|---|---|---|---|---|---|---|---|---|'
for users in "$@"; do
    echo "| $users | the daemon | $(measure "$users" "$(port daemon)")"
    echo "| $users | three relays | $(measure "$users" "$(port relay1)" "$(port relay2)" "$(port relay3)")"
done
grep -h -oE '"errors": *[0-9]+|"saturated": *[a-z]+' "$work"/load.* | sort | uniq -c >&2 || true
