#!/bin/bash
# Runs the commands of the documents, as documents.table says, and lists what came of them.
# documents.sh SOURCE BIN WORK SECONDS
#   SOURCE: the project; BIN: its programs; WORK: a folder, which is emptied first; SECONDS: a command's limit
set -u
export LC_ALL=C
source=$1 bin=$2 work=$3 limit=$4
here=$(cd "$(dirname "$0")" && pwd)
table=$here/documents.table
documents=(README.md docs/first_steps.md docs/running.md docs/access.md docs/changing.md docs/measuring.md docs/viewing.md docs/scaling.md docs/baking.md docs/baking_engines.md docs/client_guide.md)
failures=0
server='' server_pid='' address=127.0.0.1:1 # where nobody serves

# end PID: asks what runs under timeout(1) to end, which insists after the limit; returns its exit code
end() {
    kill -TERM "$1" 2>/dev/null # unless it has ended by itself
    wait "$1"
}

# await PID CONDITION...: until the condition holds; false if the process has ended without it. For what another
# process does and nothing tells of.
await() {
    local pid=$1
    shift
    until "$@"; do
        kill -0 "$pid" 2>/dev/null || { "$@"; return; }
        sleep 0.02
    done
}

stop_server() {
    local pid=$server_pid
    server='' server_pid=''
    [ -z "$pid" ] || end "$pid"
}
trap 'stop_server' EXIT
trap 'exit 1' INT TERM HUP

# ---- what the documents and the table say ----

# DOCUMENT<tab>LINE<tab>COMMAND of each indented block, and of each fenced one of a shell. Comments and
# prompts are left out, continued lines are joined, several blanks are one.
commands_of() {
    awk -v document="$1" '
        function emit(text) {
            sub(/^\$ /, "", text)
            sub(/(^|[ \t])#([ \t].*)?$/, "", text)
            gsub(/[ \t]+/, " ", text); sub(/^ /, "", text); sub(/ $/, "", text)
            if (text != "") print document "\t" first "\t" text
        }
        /^```/ { fence = !fence; shell = /^```(sh|bash|shell|console)[ \t]*$/; blank = 0; next }
        fence && !shell { next }
        /^[ \t]*$/ { blank = 1; next }
        !fence && !/^(    |\t)/ { block = 0; blank = 0; next }
        !fence && !block && !blank { next } # an indented line of a paragraph or of a list
        {
            block = 1; blank = 0
            line = $0; sub(/^[ \t]+/, "", line)
            if (rest == "") first = NR
            if (line ~ /\\$/) { rest = rest substr(line, 1, length(line) - 1) " "; next }
            emit(rest line); rest = ""
        }' "$source/$1"
}

declare -A row_line row_used value # by "DOCUMENT: COMMAND", and by that and "/KEY"
rows=()
read_table() {
    local line number=0 id='' key rest
    while IFS= read -r line; do
        number=$((number + 1))
        case $line in
        '' | '#'*) ;;
        ' '*)
            read -r key rest <<<"$line"
            case $key in
            short | server | serves | exit | prints | file | synopsis | covered | lasts) ;;
            *) complain "documents.table:$number: there is no \"$key\"" ;;
            esac
            value["$id/$key"]+=${value["$id/$key"]+$'\n'}$rest
            ;;
        *)
            id=$line
            [ -z "${row_line["$id"]+x}" ] || complain "documents.table:$number: a second row of $id"
            rows+=("$id")
            row_line["$id"]=$number
            ;;
        esac
    done <"$table"
}

complain() {
    failures=$((failures + 1))
    printf 'FAILED   %s\n' "$1"
}

# ---- files ----

number_at() { od -An -v "-t$1" -j "$2" -N 4 "$3" | tr -d ' '; }
hex_at() { od -An -v -tx1 -j "$1" -N "$2" "$3" | tr -d ' \n'; }

# size_of_exr FILE: WxH, from the data window in its header: xMin, yMin, xMax, yMax
size_of_exr() {
    local at x y
    at=$(head -c 4096 "$1" | grep -abo 'dataWindow' | head -1 | cut -d: -f1)
    [ -n "$at" ] || return
    at=$((at + 21)) # behind "dataWindow", "box2i", their zeros and the size
    x=$(($(number_at d4 $((at + 8)) "$1") - $(number_at d4 $at "$1") + 1))
    y=$(($(number_at d4 $((at + 12)) "$1") - $(number_at d4 $((at + 4)) "$1") + 1))
    echo ${x}x$y
}

size_of_png() { echo $((16#$(hex_at 16 4 "$1")))x$((16#$(hex_at 20 4 "$1"))); }

# check_file FILE [WxH]: prints what is wrong with it
check_file() {
    local file=$1 wanted=${2:-} head size=''
    [ -s "$file" ] || { echo "$file was not written, or is empty" && return; }
    head=$(hex_at 0 8 "$file")
    case $file in
    *.png)
        if [ "$head" != 89504e470d0a1a0a ] || [ "$(tail -c 8 "$file" | head -c 4)" != IEND ]; then
            echo "$file is no whole PNG" && return
        fi
        size=$(size_of_png "$file")
        ;;
    *.exr)
        [ "${head::8}" = 762f3101 ] || { echo "$file is no OpenEXR file" && return; }
        size=$(size_of_exr "$file")
        [[ $size =~ ^[1-9][0-9]{0,4}x[1-9][0-9]{0,4}$ ]] ||
            { echo "$file has no plausible size: $size" && return; }
        ;;
    *.glb)
        if [ "$head" != 676c544602000000 ] || [ "$(number_at u4 8 "$file")" != "$(stat -c %s "$file")" ]; then
            echo "$file is no whole glTF 2.0 file"
        fi
        ;;
    *.json)
        [ "$(head -c 1 "$file")$(tail -c 2 "$file" | tr -d '\n')" = '{}' ] || echo "$file is no JSON object"
        ;;
    esac
    [ -z "$wanted" ] || [ "$size" = "$wanted" ] || echo "$file has $size pixels, not $wanted"
}

# ---- programs ----

# The programs as the commands name them, with and without a folder. Where a command names the default
# address, or leaves it out, they take that of the test's own server.
make_programs() {
    local program
    mkdir -p "$work/build/release/bin" "$work/tmp"
    for program in lightwelld lightwell-relay lightwellctl lightwell-view lightwell-bake lightwell-load lightwell-import; do
        if [ ! -x "$bin/$program" ]; then
            echo "$bin/$program is missing: build the target \"programs\""
            exit 1
        fi
        {
            echo '#!/bin/bash'
            echo 'words=("${@//127.0.0.1:7780/$ADDRESS}")'
            case $program in
            lightwelld) echo 'words+=(--listen 127.0.0.1:0 --port-file port)' ;;
            lightwellctl) echo 'words=("$ADDRESS" "${words[@]}")' ;;
            lightwell-view) echo '[[ "$*" = *--path-trace* || "$1" = scene.glb ]] || words=("$ADDRESS" "${words[@]}")' ;;
            esac
            echo "exec '$bin/$program' \"\${words[@]}\""
        } >"$work/build/release/bin/$program"
        chmod +x "$work/build/release/bin/$program"
    done
    export PATH=$work/build/release/bin:$PATH TMPDIR=$work/tmp XDG_CACHE_HOME=$work/cache SOURCE=$source
    export SDL_VIDEODRIVER=dummy ADDRESS=none
    unset DISPLAY WAYLAND_DISPLAY
}

# The scenes that the documents stand in for the reader's own.
make_scenes() {
    local made=(--samples 1 --texels-per-metre 4 --gltf-out scene.glb)
    timeout -k 5 "$limit" "$bin/lightwell-bake" builtin:cornell -o made "${made[@]}" >made.log 2>&1 ||
        { cat made.log && exit 1; }
    cp scene.glb room.glb
    # what stands for builtin:atrium: to unwrap it takes longer than the rest
    cp "$bin/../scenes/atrium.lwscene" atrium.lwscene || exit 1
}

shortened() { # ID COMMAND
    sed -E "${value["$1/short"]:-}" <<<"$2"
}

# start_server ID COMMAND: unless it runs already; one at a time. Says in $problem why it does not serve.
start_server() {
    [ "$server" != "$1" ] || return 0
    stop_server || { problem="the server before ended with $?" && return 1; }
    rm -f port
    setpriv --pdeathsig TERM timeout --foreground -k "$limit" $((limit * 4)) \
        bash -c "exec $(shortened "$1" "$2")" >server.log 2>&1 </dev/null &
    server=$1 server_pid=$!
    if ! await $server_pid test -s port; then
        stop_server
        problem="\"$2\" does not serve: $(tail -3 server.log)"
        return 1
    fi
    address=127.0.0.1:$(cat port)
}

# check_synopsis LINE PROGRAM...: its help lists every option of the line, those that end it included
check_synopsis() {
    local text=$1 help option
    shift
    help=$(timeout "$limit" "$@" --help 2>&1) || { echo "\"$* --help\" fails" && return; }
    for option in $(grep -oE -- '(^|[ []|\()-(o|-[a-z][a-z-]*)' <<<"$text" | tr -d ' [('); do
        grep -qE -- "(^|[ ,])$option([ ,]|\$)" <<<"$help" || echo "\"$* --help\" does not list $option"
    done
}

# takes_signals PID: whether what timeout(1) runs there has a handler for SIGTERM
takes_signals() {
    local child caught
    child=$(cat "/proc/$1/task/$1/children" 2>/dev/null) && [ -n "$child" ] || return
    caught=$(sed -n 's/^SigCgt:[ \t]*//p' "/proc/${child%% *}/status" 2>/dev/null) && [ -n "$caught" ] || return
    ((16#$caught >> 14 & 1))
}

joined_more_than() { [ "$(grep -c ' joined' server.log)" -gt "$1" ]; }

# run_until_joined COMMAND: a client, ended once the server has welcomed it; returns its exit code
run_until_joined() {
    local pid before
    before=$(grep -c ' joined' server.log)
    ADDRESS=$address setpriv --pdeathsig TERM timeout --foreground -k "$limit" "$limit" bash -c "exec $1" &
    pid=$!
    await $pid joined_more_than "$before" && await $pid takes_signals $pid
    end $pid
}

# run_command ID COMMAND: sets $problem, empty if all is well
run_command() {
    local id=$1 command code wanted=${value["$1/exit"]:-0} entry file size
    command=$(shortened "$id" "$2")
    while read -r file size; do
        if [ -n "$file" ]; then rm -rf $file; fi
    done <<<"${value["$id/file"]:-}"
    if [ -n "${value["$id/lasts"]+x}" ]; then
        run_until_joined "$command" >command.log 2>&1 </dev/null
    else
        ADDRESS=$address timeout -k 5 "$limit" bash -c "$command" >command.log 2>&1 </dev/null
    fi
    code=$?
    if [ "$code" != "$wanted" ]; then problem="exit code $code, not $wanted"; fi
    while read -r entry; do
        if [ -n "$entry" ] && ! grep -qE -- "$entry" command.log; then
            problem+=${problem:+; }"it does not print \"$entry\""
        fi
    done <<<"${value["$id/prints"]:-}"
    while read -r entry size; do
        [ -n "$entry" ] || continue
        for file in $entry; do
            code=$(check_file "$file" "$size")
            if [ -n "$code" ]; then problem+=${problem:+; }$code; fi
        done
    done <<<"${value["$id/file"]:-}"
    if [ -n "$problem" ]; then
        problem+=$'\n'"         ran: $command"$'\n'$(tail -12 command.log | sed 's/^/         | /')
    fi
}

seconds_since() {
    local us=$((${EPOCHREALTIME/./} - ${1/./}))
    echo $((us / 1000000)).$((us / 100000 % 10))
}

# Whether a text stands in the section of a document above a line.
said_above() { # DOCUMENT LINE TEXT
    head -$(($2 - 1)) "$source/$1" |
        awk '/^#+ / { text = "" } { text = text "\n" $0 } END { print text }' | grep -qF -- "$3"
}

check_command() { # DOCUMENT LINE COMMAND
    local id="$1: $3" how=ok note='' began=$EPOCHREALTIME
    problem=''
    if [ -z "${row_line["$id"]+x}" ]; then
        complain "$1:$2: new command, say in ${table#"$source/"} how it is checked: $3"
        return
    fi
    row_used["$id"]=1
    if [ -n "${value["$id/short"]+x}" ]; then how=short; fi
    if [ -n "${value["$id/covered"]+x}" ]; then
        how=covered note=${value["$id/covered"]}
    elif [ -n "${value["$id/synopsis"]+x}" ]; then
        how=synopsis problem=$(check_synopsis "$3" ${value["$id/synopsis"]})
    elif [ -n "${value["$id/serves"]+x}" ]; then
        start_server "$id" "$3"
    else
        local on=${value["$id/server"]:-}
        if [ -z "$on" ]; then
            stop_server || problem="the server before ended with $?"
            address=127.0.0.1:1
        elif ! said_above "$1" "$2" "$on"; then
            problem="the section does not say that it is for \"$on\""
        elif start_server "$1: $on" "$on"; then
            row_used["$1: $on"]=1
        fi
        if [ -z "$problem" ]; then run_command "$id" "$3"; fi
    fi
    if [ -n "$problem" ]; then
        complain "$1:$2: $3"$'\n'"         $problem"
        return
    fi
    printf '%-8s %5.1f s  %s:%s: %s%s\n' \
        $how "$(seconds_since "$began")" "$1" "$2" "$3" "${note:+ ($note)}"
    if [ $how = short ]; then printf '         %9sran: %s\n' '' "$(shortened "$id" "$3")"; fi
}

rm -rf "$work"
mkdir -p "$work"
cd "$work" || exit 1
read_table
make_programs
make_scenes
while IFS=$'\t' read -r document line command <&3; do
    check_command "$document" "$line" "$command"
done 3< <(for document in "${documents[@]}"; do commands_of "$document"; done)
stop_server || complain "the last server ended with $?, not 0"
for id in "${rows[@]}"; do
    [ -n "${row_used["$id"]+x}" ] ||
        complain "documents.table:${row_line["$id"]}: no document has this command any more: $id"
done
[ $failures = 0 ] || echo "documents: $failures of the commands or rows above failed"
[ $failures = 0 ]
