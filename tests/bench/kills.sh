#!/bin/bash
# kills.sh BIN SCENE FOLDER: age of light and received bytes at three relays while a relay, the daemon and nats-server
# are killed in turn, each by SIGKILL, and started again. Relays 1 and 2 take light from NATS, relay 3 from the daemon.
# Prints a table. FOLDER, a new one, gets a series of each relay's users, events.csv and, where there is gnuplot, kills.svg.
# LW_KILLS_USERS (default 50): walking users of each relay. LW_KILLS_SECONDS (default 15): from a restart to the next kill.
set -euo pipefail
bin=$1 scene=$2 folder=$3
here=$(cd "$(dirname "$0")" && pwd)
users=${LW_KILLS_USERS:-50} seconds=${LW_KILLS_SECONDS:-15}
mkdir "$folder"
work=$(mktemp -d)
declare -A pid
loads=()
trap 'kill "${pid[@]}" "${loads[@]}" 2>/dev/null || true; wait; rm -rf "$work"' EXIT
export OMP_WAIT_POLICY=passive XDG_CACHE_HOME=$work/cache LIGHTWELL_LOG_FORMAT=text PATH=$PATH:/usr/sbin

port() { cat "$work/$1.port"; }
note() { echo "$EPOCHREALTIME,$1" | tee -a "$folder/events.csv" >&2; }

# until_it NAME CONDITION...: waits for it while NAME lives
until_it() {
    local name=$1
    shift
    until "$@"; do
        kill -0 "${pid[$name]}" 2>/dev/null || { cat "$work/$name.log" && exit 1; }
        sleep 0.05
    done
}

# start NAME PROGRAM ARGUMENTS...: at the port that it had before, or at a free one
start() {
    local name=$1 program=$2 at=0
    shift 2
    [ ! -e "$work/$name.port" ] || at=$(port "$name")
    "$bin/$program" "$@" --listen "127.0.0.1:$at" --port-file "$work/$name.now" --http none --control-socket none \
        2>>"$work/$name.log" &
    pid[$name]=$!
    until_it "$name" [ -s "$work/$name.now" ]
    mv "$work/$name.now" "$work/$name.port"
}

start_nats() {
    local at=-1
    [ ! -e "$work/nats.port" ] || at=$(port nats)
    nats-server --addr 127.0.0.1 --port "$at" --jetstream --store_dir "$work/jetstream" 2>"$work/nats.log" &
    pid[nats]=$!
    until_it nats grep -q 'Server is ready' "$work/nats.log"
    sed -n 's/.*client connections on [0-9.]*:\([0-9]*\)$/\1/p' "$work/nats.log" >"$work/nats.port"
}
start_daemon() {
    start daemon lightwelld "$scene" --threads 1 --frame-rate 10 --nats "nats://127.0.0.1:$(port nats)/kills"
}
start_relay() { start "relay$1" lightwell-relay "$2"; }
by_nats() { echo "nats://127.0.0.1:$(port nats)/kills"; }

# kill_it NAME: SIGKILL
kill_it() {
    note "$1 is killed"
    kill -KILL "${pid[$1]}"
    wait "${pid[$1]}" 2>/dev/null || true
    sleep 0.25 # RestartSec of packaging/systemd
}

start_nats
start_daemon
start_relay 1 "$(by_nats)"
start_relay 2 "$(by_nats)"
start_relay 3 "127.0.0.1:$(port daemon)"
for n in 1 2 3; do
    "$bin/lightwell-load" "127.0.0.1:$(port relay$n)" --users "$users" --ramp "$((users / 5 + 10))" --seconds 100000 \
        --path walk --reconnect --json --series "$folder/relay$n.csv" >"$folder/relay$n.json" 2>"$work/load$n.log" &
    loads+=($!)
done
sleep $((seconds + 8)) # all have joined, and first views are over
kill_it relay1
start_relay 1 "$(by_nats)"
note 'relay1 is back'
sleep "$seconds"
kill_it daemon
start_daemon
note 'daemon is back'
sleep "$seconds"
kill_it nats
start_nats
note 'nats is back'
sleep "$seconds"
kill -INT "${loads[@]}"
wait "${loads[@]}" || true # it was interrupted
grep -H -A 15 '"errors"' "$folder"/relay*.json | grep -E '"[a-z]+": [1-9]' >&2 || echo 'no errors of users' >&2

# From each kill to the next one: the oldest light of any user, and what a user received.
echo '| killed | oldest light, s: relay 1 | relay 2 | relay 3 | received, kB a user: relay 1 | relay 2 | relay 3 |'
echo '|---|---|---|---|---|---|---|'
grep killed "$folder/events.csv" | awk -F, '{ if (at) print what "," at "," $1; at = $1; what = $2; sub(/ is killed/, "", what) }
    END { print what "," at ",9e99" }' | while IFS=, read -r what from to; do
    ages='' sums=''
    for n in 1 2 3; do
        read -r age sum < <(awk -F, -v from="$from" -v to="$to" -v users="$users" 'NR > 1 && $1 >= from && $1 < to {
            if ($5 > age) age = $5
            sum += $3
        } END { printf "%.2f %.0f\n", age / 1000, sum / users / 1000 }' "$folder/relay$n.csv")
        ages+=" $age |" sums+=" $sum |"
    done
    echo "| $what |$ages$sums"
done
! command -v gnuplot >/dev/null || gnuplot -e "folder='$folder'; users=$users" "$here/kills.gnuplot"
