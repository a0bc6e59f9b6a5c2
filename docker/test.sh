#!/bin/bash
# Runs the steps of docker/Dockerfile without Docker, each stage in a root folder that mmdebstrap makes; then
# what Docker would run: the server, as the image's user and as process 1, in a root that it cannot write, and its
# HEALTHCHECK.
#     docker/test.sh            in a temporary folder, which it removes
#     docker/test.sh FOLDER     in FOLDER, a new one, which stays
# Wants root, mmdebstrap, iproute2, a Debian 12 whose apt sources and proxies it passes on, 3 GB and minutes.
# The server listens in a network namespace of its own.
set -euo pipefail
folder=${1:+$(realpath --canonicalize-missing "$1")}
cd "$(dirname "$0")/.."
. packaging/debian_root.sh

die() {
    echo "docker/test.sh: $1" >&2
    exit 1
}

[ "$(id -u)" -eq 0 ] || die "only root may make a root folder and namespaces"
for tool in mmdebstrap ip unshare nsenter; do
    command -v "$tool" >/dev/null || die "$tool is missing: apt-get install mmdebstrap iproute2 util-linux"
done
# Mounts are in a namespace of their own, and end with it.
if [ "${LW_DOCKER_TEST_UNSHARED:-}" != 1 ]; then
    LW_DOCKER_TEST_UNSHARED=1 exec unshare --mount --propagation private docker/test.sh "$folder"
fi

launcher='' # of the server, its only child
work=${folder:-$(mktemp -d "${TMPDIR:-/var/tmp}/lightwell-docker.XXXXXX")}
[ -z "$folder" ] || mkdir "$folder" || die "FOLDER must be a new one"
server_pid() { tr -d ' ' <"/proc/$launcher/task/$launcher/children"; }
finish() {
    [ -z "$launcher" ] || kill -KILL "$(server_pid)" || true # with which the launcher ends
    unmount_below "$work"
    [ -n "$folder" ] || rm -rf --one-file-system "$work"
}
trap finish EXIT

# ---- what Docker's base image and its build context are ----

# make_base: $work/base, as debian:12-slim is
make_base() {
    echo "docker/test.sh: the base of both stages" >&2
    make_debian_root "$work" "$work/base" \
        --dpkgopt='path-exclude=/usr/share/man/*' --dpkgopt='path-exclude=/usr/share/locale/*' \
        --dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-include=/usr/share/doc/*/copyright' ||
        die "there is no base"
    echo 'APT::Keep-Downloaded-Packages "false"; Dir::Cache { pkgcache ""; srcpkgcache ""; };' \
        >"$work/base/etc/apt/apt.conf.d/docker-clean"
}

# make_context: $work/context, the tree but for what Dockerfile.dockerignore names
make_context() {
    local name exclude=()
    while read -r name; do
        [[ $name =~ ^[.A-Za-z0-9_/-]+$ ]] || die "Dockerfile.dockerignore: \"$name\" is no plain path"
        exclude+=("--exclude=./$name")
    done <docker/Dockerfile.dockerignore
    mkdir "$work/context"
    tar --create --anchored "${exclude[@]}" . | tar --extract --no-same-owner --directory "$work/context"
}

# ---- the instructions ----

stage='' root='' user='' workdir='' port='' entrypoint=() cmd=() healthcheck=() health_timeout=30
enter=() # what goes before a command that is to run in the stage
extra_ca=/etc/extra_ca.pem # ca-certificates overwrites its own list of certificates, so ours is beside it

stage_changed() {
    local home variable
    home=$(awk -F: -v user="$user" '$1 == user { print $6 }' "$root/etc/passwd")
    [ -n "$home" ] || die "USER $user is nobody in stage $stage"
    enter=(chroot --userspec="$user" "$root" /usr/bin/env --ignore-environment --chdir="$workdir"
        PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "HOME=$home")
    for variable in http_proxy https_proxy no_proxy; do
        [ -z "${!variable:-}" ] || enter+=("$variable=${!variable}")
    done
    [ ! -e "$root$extra_ca" ] || enter+=("NODE_EXTRA_CA_CERTS=$extra_ca")
}

# from IMAGE [AS NAME]
from() {
    [ "$1" = debian:12-slim ] || die "FROM $1: only debian:12-slim is understood"
    [ $# -eq 1 ] || { [ $# -eq 3 ] && [ "$2" = AS ]; } || die "FROM $*"
    stage=${3:-run}
    root=$work/$stage user=root workdir=/ entrypoint=() cmd=() healthcheck=()
    cp -a "$work/base" "$root"
    if [ -e "${NODE_EXTRA_CA_CERTS:-}" ]; then # whom npm believes beside what it brings, behind a proxy
        cp --dereference "$NODE_EXTRA_CA_CERTS" "$root$extra_ca"
    fi
    mount -t proc proc "$root/proc"
    stage_changed
}

# copy [--from=STAGE] SOURCE... TARGET
copy() {
    local from=$work/context source
    if [[ $1 == --from=* ]]; then
        from=$work/${1#--from=}
        shift
    fi
    local target=${*: -1}
    [[ $target == /* ]] || target=$workdir/$target
    for source in "${@:1:$#-1}"; do
        [[ $source != *[*?\[\$]* && $source != --* && -e $from/$source ]] || die "COPY $*: no $source"
        if [ -d "$from/$source" ]; then
            mkdir -p "$root/$target"
            cp -a "$from/$source/." "$root/$target"
        else
            [[ $target == */ ]] || die "COPY $*: the target of a file must be a folder, with / at the end"
            mkdir -p "$root/$target"
            cp -a "$from/$source" "$root/$target"
        fi
    done
}

# exec_form '["WORD", ...]': into the array words
exec_form() {
    local rest=$1
    words=()
    [[ $rest =~ ^\[(.*)\]$ ]] || die "only the form [\"WORD\", ...] is understood, not $1"
    rest=${BASH_REMATCH[1]}
    while [[ $rest =~ ^\"([^\"\\]*)\"(, *|$)(.*)$ ]]; do
        words+=("${BASH_REMATCH[1]}")
        rest=${BASH_REMATCH[3]}
    done
    [[ -z $rest && ${#words[@]} -gt 0 ]] || die "only the form [\"WORD\", ...] is understood, not $1"
}

# instruction NAME REST
instruction() {
    local rest=$2 words
    echo "docker/test.sh: $1 $2" >&2
    read -ra words <<<"$rest"
    case $1 in
    FROM) from "${words[@]}" ;;
    RUN) "${enter[@]}" /bin/sh -c "$rest" ;;
    COPY) copy "${words[@]}" ;;
    USER) user=$rest && stage_changed ;;
    WORKDIR)
        [[ $rest == /* ]] || die "WORKDIR $rest: only absolute paths are understood"
        workdir=$rest
        mkdir -p "$root/$workdir"
        stage_changed
        ;;
    EXPOSE) port=$rest ;;
    HEALTHCHECK)
        while [[ $rest =~ ^--(interval|timeout|start-period)=([0-9]+[sm])\ +(.*)$ ]]; do
            [ "${BASH_REMATCH[1]}" != timeout ] || health_timeout=${BASH_REMATCH[2]}
            rest=${BASH_REMATCH[3]}
        done
        [[ $rest == CMD\ * ]] || die "HEALTHCHECK $rest: CMD is missing, or an option is unknown"
        exec_form "${rest#CMD }"
        healthcheck=("${words[@]}")
        ;;
    ENTRYPOINT) exec_form "$rest" && entrypoint=("${words[@]}") ;;
    CMD) exec_form "$rest" && cmd=("${words[@]}") ;;
    *) die "the instruction $1 is unknown here" ;;
    esac
}

run_dockerfile() {
    local line joined=''
    while read -r line; do
        [[ $line != \#* ]] || continue
        joined+=$line
        if [[ $joined == *\\ ]]; then
            joined=${joined%\\}
        elif [ -n "$joined" ]; then
            instruction "${joined%% *}" "${joined#* }" </dev/null
            joined=''
        fi
    done <docker/Dockerfile
    [ -z "$joined" ] || die "docker/Dockerfile ends within an instruction"
}

# ---- the server ----

# make_read_only: from here on the stage's root is as docker run --read-only --tmpfs /tmp gives it, with a volume at
# the user's home
make_read_only() {
    local written=$root home
    home=$(awk -F: -v user="$user" '$1 == user { print $6 }' "$root/etc/passwd")
    root=$work/read_only
    mkdir "$root"
    mount --bind "$written" "$root"
    mount -o remount,bind,ro "$root"
    mount -t proc proc "$root/proc"
    mount -t tmpfs -o mode=1777 tmpfs "$root/tmp"
    mount --bind "$written$home" "$root$home"
    stage_changed
}

in_network() { nsenter --net="$work/net" "$@"; }
is_healthy() {
    in_network timeout "$health_timeout" "${enter[@]}" "${healthcheck[@]}" >"$work/health.log" 2>&1
}

# serve ARGUMENT...: the server until it is healthy, then until it has stopped
serve() {
    echo "docker/test.sh: the server lights $*" >&2
    ! is_healthy || die "the HEALTHCHECK is content without a server"
    nsenter --net="$work/net" unshare --pid --fork "${enter[@]}" "${entrypoint[@]}" "$@" \
        >"$work/server.log" 2>&1 &
    launcher=$!
    local server='' until=$((SECONDS + 180)) status=0
    until is_healthy; do
        kill -0 "$launcher" 2>/dev/null || die "the server has ended: $(cat "$work/server.log")"
        [ $SECONDS -lt $until ] || die "not healthy: $(cat "$work/health.log" "$work/server.log")"
        sleep 1
    done
    server=$(server_pid)
    grep -Eq '^NSpid:.*\s1$' "/proc/$server/status" || die "the server is not process 1"
    ! grep -Eq '^Uid:.*\s0(\s|$)' "/proc/$server/status" || die "the server runs as root"
    # another address than the usual one of loopback: it listens on all that there are
    in_network "${enter[@]}" lightwellctl --timeout 180 "127.0.0.2:$port" list >/dev/null ||
        die "the server does not listen everywhere at port $port"
    kill -TERM "$server"
    until=$((SECONDS + 60))
    while kill -0 "$launcher" 2>/dev/null; do
        [ $SECONDS -lt $until ] || die "the server does not stop: $(cat "$work/server.log")"
        sleep 0.2
    done
    wait "$launcher" || status=$?
    launcher=''
    [ $status -eq 0 ] || die "the server ended with $status: $(cat "$work/server.log")"
}

make_base
make_context
run_dockerfile

[ "$user" != root ] || die "no USER: the server would run as root"
size="$(du -smx "$root" | cut -f1) MB, $(du -smx "$work/base" | cut -f1) of them Debian's own"
programs=$(cd "$root/usr/local/bin" && echo *)
for program in $programs; do
    "${enter[@]}" "$program" --help >/dev/null || die "$program does not start"
done

make_read_only
touch "$work/net"
unshare --net="$work/net" ip link set lo up
serve "${cmd[@]}"

# A scene file that is mounted, and light that is kept.
mkdir "$work/scene"
cp tests/fuzz/corpus/fuzz_gltf/base.gltf "$work/scene"
mount --bind "$work/scene" "$root$workdir"
serve base.gltf --sky 1,1,1 --light whole --keep /var/lib/lightwell/keep
[ -n "$(ls "$root/var/lib/lightwell/keep")" ] || die "no light was kept"

echo "docker/test.sh: passed: $programs; the run stage has $size"
