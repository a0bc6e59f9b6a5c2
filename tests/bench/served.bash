# served.bash: a server for benches in shell. To be sourced.
bin=${LW_BIN:-$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)/build/release/bin}
daemon=
address= # where it serves

# run LOG COMMAND...: quiet, unless it fails
run() {
    local log=$1
    shift
    "$@" >"$log" 2>&1 || { cat "$log" >&2; exit 1; }
}

# until_true LOG CONDITION...: waits for it, ten minutes at most and no longer than the server lives; LOG says why not
until_true() {
    local log=$1
    shift
    for _ in $(seq 6000); do
        ! "$@" || return 0
        kill -0 "$daemon" 2>/dev/null || break
        sleep 0.1
    done
    cat "$log" >&2
    exit 1
}

# serve FOLDER SCENE OPTION...: a server; its lines are in FOLDER/served
serve() {
    local folder=$1
    shift
    rm -f "$folder/port"
    "$bin/lightwelld" --listen 127.0.0.1:0 --http none --control-socket none --port-file "$folder/port" "$@" \
        <&0 2>"$folder/served" & # without the first its lines would be of /dev/null
    daemon=$!
    until_true "$folder/served" [ -s "$folder/port" ]
    address=127.0.0.1:$(cat "$folder/port")
}

stop_serving() {
    [ -z "$daemon" ] || kill "$daemon" 2>/dev/null || true
    [ -z "$daemon" ] || wait "$daemon" || true
    daemon=
}
