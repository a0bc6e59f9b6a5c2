#!/bin/bash
# Runs the services of docker/compose.relays.yaml without Docker, at their own addresses and with their own
# options: each in a root folder, a network namespace and with the limits of its container. docker/test.sh makes
# the image.
#     docker/test.sh FOLDER && docker/test_relays.sh FOLDER
# nats-server and Prometheus are Debian's, each in a root folder of its own. Grafana is not in Debian:
# Prometheus answers the queries of its dashboard. tests/integration/compose.mjs starts the services and looks at them.
# Wants what docker/test.sh wants, and Node.js.
set -euo pipefail
folder=$(realpath "${1:-}")
cd "$(dirname "$0")/.."
. packaging/debian_root.sh

die() {
    echo "docker/test_relays.sh: $1" >&2
    exit 1
}
step() { echo "docker/test_relays.sh: $1" >&2; }

[ -d "$folder/run" ] || die "usage: docker/test_relays.sh FOLDER, which docker/test.sh has made"
[ "$(id -u)" -eq 0 ] || die "only root may make namespaces"
for tool in ip unshare nsenter node; do
    command -v "$tool" >/dev/null || die "$tool is missing: apt-get install iproute2 util-linux nodejs"
done
# Mounts are in a namespace of their own, and end with it.
if [ "${LW_DOCKER_TEST_UNSHARED:-}" != 1 ]; then
    LW_DOCKER_TEST_UNSHARED=1 exec unshare --mount --propagation private docker/test_relays.sh "$folder"
fi

compose=docker/compose.relays.yaml
image_user=$(sed -n 's/^USER //p' docker/Dockerfile)
image_folder=$(sed -n 's/^WORKDIR //p' docker/Dockerfile | tail -n 1)
work=$(mktemp -d "${TMPDIR:-/var/tmp}/lightwell-relays.XXXXXX")
finish() {
    unmount_below "$work"
    rm -rf --one-file-system "$work"
}
trap finish EXIT
mkdir "$work/in" "$work/net" "$work/root" "$work/volume"

# ---- images that are not ours ----

# install_root NAME PACKAGE PROGRAM: $folder/NAME, Debian with a package, as the image of a service
install_root() {
    local root=$folder/$1 log=$work/$1.log variable settings=()
    [ ! -e "$root/$3" ] || return 0
    step "installing $2 in a root folder"
    for variable in http_proxy https_proxy no_proxy; do
        [ -z "${!variable:-}" ] || settings+=("$variable=${!variable}")
    done
    cp -a "$folder/base" "$root"
    mount -t proc proc "$root/proc"
    printf '#!/bin/sh\nexit 101\n' | install -m 755 /dev/stdin "$root/usr/sbin/policy-rc.d" # no service begins
    chroot "$root" /usr/bin/env --ignore-environment PATH=/usr/sbin:/usr/bin:/sbin:/bin DEBIAN_FRONTEND=noninteractive \
        "${settings[@]}" /bin/sh -c "apt-get update && apt-get install -y --no-install-recommends $2" >"$log" 2>&1 ||
        die "$2: $(tail "$log")"
    umount "$root/proc"
}
install_root nats nats-server usr/sbin/nats-server
install_root prometheus prometheus usr/bin/prometheus

# ---- the network: a bridge of this machine, and a cable to each container ----

network=10.77.0
names=$(sed -n '/^services:/,/^[a-z]*:$/ s/^  \([a-z0-9-]*\):$/\1/p' "$compose" | grep -vx grafana)
touch "$work/net/host"
unshare --net="$work/net/host" sh -c 'ip link set lo up && ip link add bridge type bridge && ip link set bridge up' ||
    die "no bridge can be made"
on_host() { nsenter --net="$work/net/host" "$@"; }
on_host ip address add $network.1/24 dev bridge
echo '127.0.0.1 localhost' >"$work/hosts"

# make_network NAME NUMBER
make_network() {
    touch "$work/net/$1"
    unshare --net="$work/net/$1" ip link set lo up
    on_host ip link add "to-$2" type veth peer name eth0 netns "$work/net/$1"
    on_host ip link set "to-$2" master bridge up
    nsenter --net="$work/net/$1" ip address add "$network.$2/24" dev eth0
    nsenter --net="$work/net/$1" ip link set eth0 up
    echo "$network.$2 $1" >>"$work/hosts"
}

# ---- containers ----

# lines_of NAME: a service's lines of the compose file
lines_of() { awk -v name="  $1:" '$0 == name { is_in = 1; next } /^  [a-z]/ || /^[a-z]/ { is_in = 0 } is_in' "$compose"; }

# mount_volume ROOT SOURCE TARGET [ro]: a folder beside the compose file, or a volume, which begins as the image has it
mount_volume() {
    local from=$work/volume/$2
    mkdir -p "$1$3"
    if [[ $2 == ./* || $2 == ../* ]]; then
        from=docker/$2
    elif [ ! -e "$from" ]; then
        cp -a "$1$3" "$from"
    fi
    mount --bind "$from" "$1$3"
    [ "${4:-}" != ro ] || mount -o remount,bind,ro "$1$3"
}

# make_container NAME: a root, and $work/in/NAME, a program that runs a command in it
make_container() {
    local name=$1 root=$work/root/$1 image=$folder/run user=$image_user at=$image_folder volume home
    case $name in
    nats) image=$folder/nats user=root at=/ ;;
    prometheus)
        image=$folder/prometheus user=nobody at=/
        install -d -o nobody "$image/prometheus" # as the image prom/prometheus has it
        ;;
    esac
    # what Docker makes in any image
    mkdir -p "$root" "$image$at"
    touch "$image/etc/hosts"
    mount --bind "$image" "$root"
    mount --bind "$work/hosts" "$root/etc/hosts"
    lines_of "$name" | sed -n 's/^      - "\{0,1\}\([a-z./][^ "]*:\/[^ "]*\)"\{0,1\}.*/\1/p' >"$work/volumes"
    while IFS=: read -r -a volume; do mount_volume "$root" "${volume[@]}"; done <"$work/volumes"
    mount -t proc proc "$root/proc"
    if lines_of "$name" | grep -q '<<: \*lightwell'; then # read_only, tmpfs
        mount -o remount,bind,ro "$root"
        mount -t tmpfs -o mode=1777 tmpfs "$root/tmp"
    fi
    home=$(awk -F: -v user="$user" '$1 == user { print $6 }' "$root/etc/passwd")
    # cap_drop, no-new-privileges; nats runs as the root of its image, with what is left to it
    cat >"$work/in/$name" <<END
#!/bin/sh
exec nsenter --net='$work/net/$name' unshare --uts /bin/sh -c 'hostname "\$0" && exec "\$@"' '$name' \\
    chroot '$root' /usr/bin/env --ignore-environment --chdir='$at' \\
    PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME='$home' OMP_WAIT_POLICY=passive \\
    setpriv --reuid='$user' --regid="\$(awk -F: -v user='$user' '\$1 == user { print \$4 }' '$root/etc/passwd')" \\
    --clear-groups --bounding-set=-all --inh-caps=-all --no-new-privs -- "\$@"
END
    chmod +x "$work/in/$name"
}

number=2
for name in $names; do
    make_network "$name" $number
    number=$((number + 1))
done
make_container host # a program of the image on this machine
for name in $names; do make_container "$name"; done
mount --bind "$work/hosts" /etc/hosts
for limit in 'read_only: true' '- /tmp' '- ALL' '- no-new-privileges:true'; do
    grep -qF -- "$limit" "$compose" || die "$compose: a container has other limits than here"
done
! "$work/in/daemon" touch /x 2>/dev/null || die "the daemon's root can be written"
"$work/in/daemon" grep -q '^CapBnd:.0*$' /proc/self/status || die "the daemon has capabilities"

step "the services: ${names//$'\n'/ }"
on_host node tests/integration/compose.mjs "$PWD" "$folder/run/usr/local/bin" "$work/in"
