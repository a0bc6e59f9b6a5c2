#!/bin/bash
# Builds the Debian packages from this tree, installs them in a root folder that mmdebstrap makes, runs what they
# hold, and removes them.
#     packaging/test.sh            in a temporary folder, which it removes
#     packaging/test.sh FOLDER     in FOLDER, a new one, which stays: the packages are in FOLDER/packages
# Wants root, what scripts/deps.sh installs, dpkg-dev, debhelper, mmdebstrap, iproute2, a Debian 12 whose apt sources
# and proxies it passes on, 3 GB and minutes. Exit code 77 and a line where something of that is missing.
# LW_JOBS sets how many compilers run at once. The server listens in a network namespace of its own.
set -euo pipefail
folder=${1:+$(realpath --canonicalize-missing "$1")}
cd "$(dirname "$0")/.."
. packaging/debian_root.sh

die() {
    echo "packaging/test.sh: $1" >&2
    exit 1
}
skip() {
    echo "packaging/test.sh: skipped: $1" >&2
    exit 77
}
step() { echo "packaging/test.sh: $1" >&2; }

[ "$(id -u)" -eq 0 ] || skip "only root may make a root folder and namespaces"
for tool in dpkg-buildpackage dh mmdebstrap ip unshare nsenter; do
    command -v "$tool" >/dev/null || skip "$tool is missing: apt-get install dpkg-dev debhelper mmdebstrap iproute2"
done
unshare --mount --net true 2>/dev/null || skip "namespaces are not allowed here"
# Mounts are in a namespace of their own, and end with it.
if [ "${LW_PACKAGING_TEST_UNSHARED:-}" != 1 ]; then
    LW_PACKAGING_TEST_UNSHARED=1 exec unshare --mount --propagation private packaging/test.sh "$folder"
fi

server='' # its process
work=${folder:-$(mktemp -d "${TMPDIR:-/var/tmp}/lightwell-packages.XXXXXX")}
[ -z "$folder" ] || mkdir "$folder" || die "FOLDER must be a new one"
root=$work/root
finish() {
    [ -z "$server" ] || kill -KILL "$server" 2>/dev/null || true
    unmount_below "$work"
    [ -n "$folder" ] || rm -rf --one-file-system "$work"
}
trap finish EXIT

# ---- the packages ----

step "building the packages"
mkdir "$work/tree" "$work/packages"
# what git knows, as it is now, and the npm packages that the browser client is built with
git ls-files -z | tar --create --null --files-from=- | tar --extract --no-same-owner --directory "$work/tree"
[ ! -d client/web/node_modules ] || cp -a client/web/node_modules "$work/tree/client/web/"
(cd "$work/tree" && DEB_BUILD_OPTIONS="noautodbgsym parallel=${LW_JOBS:-$(nproc)}" DPKG_GENSYMBOLS_CHECK_LEVEL=4 \
    dpkg-buildpackage --build=binary --unsigned-changes --unsigned-source >"$work/build.log" 2>&1) ||
    die "dpkg-buildpackage: $(tail -n 30 "$work/build.log")"
mv "$work"/*.deb "$work/packages/"
for name in lightwell liblightwell1 liblightwell-dev; do
    compgen -G "$work/packages/${name}_*.deb" >/dev/null || die "no package $name was built"
done
rm -rf "$work/tree"

# ---- installing ----

step "a root folder of Debian 12"
make_debian_root "$work" "$root" || skip "there is no root folder"
mount -t proc proc "$root/proc"
inside=(chroot "$root" /usr/bin/env --ignore-environment PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root
    DEBIAN_FRONTEND=noninteractive)
for variable in http_proxy https_proxy no_proxy; do
    [ -z "${!variable:-}" ] || inside+=("$variable=${!variable}")
done
mkdir "$root/packages"
cp "$work"/packages/*.deb "$root/packages/"
step "installing the packages"
"${inside[@]}" apt-get update >"$work/apt.log" 2>&1 || die "apt-get update: $(tail "$work/apt.log")"
"${inside[@]}" /bin/sh -c 'apt-get install -y --no-install-recommends /packages/*.deb' >>"$work/apt.log" 2>&1 ||
    die "apt-get install: $(tail -n 30 "$work/apt.log")"
"${inside[@]}" /bin/sh -c 'dpkg-query --listfiles lightwell liblightwell1 liblightwell-dev' |
    sed -n 's|^/.*|&|p' | sort -u >"$work/files"

# ---- what they hold ----

programs='lightwelld lightwell-relay lightwellctl lightwell-view lightwell-bake lightwell-import lightwell-load'
for program in $programs; do
    "${inside[@]}" "$program" --version >/dev/null || die "$program does not start"
done
documents='LICENSE README.md CHANGELOG.md SECURITY.md docs/licences.md docs/running.md proto/wire_format.md copyright'
for file in $(printf 'usr/share/doc/lightwell/%s ' $documents) lib/systemd/system/lightwelld.service \
    etc/lightwell/lightwelld.conf usr/share/bash-completion/completions/lightwelld; do
    [ -e "$root/$file" ] || die "/$file is missing"
done

# A program that is built with liblightwell-dev, by this machine's compiler.
library=$(echo "$root"/usr/lib/*/pkgconfig)
read -ra flags < <(PKG_CONFIG_LIBDIR=$library pkg-config --cflags --libs lightwell)
cc examples/minimal.c -o "$root/usr/bin/minimal" "${flags[@]}" || die "examples/minimal.c is not built by the package"

# ---- the server, as the unit starts it ----

step "the server, from the package"
touch "$work/net"
unshare --net="$work/net" ip link set lo up
in_network() { nsenter --net="$work/net" "$@"; }
mkdir -p "$root/var/lib/lightwell" "$root/run/lightwell"
chown 65534:65534 "$root/var/lib/lightwell" "$root/run/lightwell"
read -ra command < <(sed -n 's/^ExecStart=//p' "$root/lib/systemd/system/lightwelld.service")
as_nobody=(chroot --userspec=65534:65534 "$root" /usr/bin/env --ignore-environment PATH=/usr/bin:/bin
    HOME=/var/lib/lightwell RUNTIME_DIRECTORY=/run/lightwell)
nsenter --net="$work/net" "${as_nobody[@]}" "${command[@]}" >"$work/server.log" 2>&1 &
server=$!
until=$((SECONDS + 180))
until in_network "${as_nobody[@]}" lightwellctl --timeout 5 status >"$work/status.log" 2>&1; do
    kill -0 "$server" 2>/dev/null || die "the server has ended: $(cat "$work/server.log")"
    [ $SECONDS -lt $until ] || die "it does not serve: $(cat "$work/status.log" "$work/server.log")"
    sleep 1
done
# page PORT PATH: status and body of an HTTP page
page() {
    in_network bash -c 'exec 3<>"/dev/tcp/127.0.0.1/$1" &&
        printf "GET %s HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n" "$2" >&3 && timeout 10 cat <&3' _ "$1" "$2"
}
page 7782 /healthz | head -n 1 | grep -q ' 200 ' || die "/healthz is not content"
page 7782 /metrics | grep -q '^lightwell_build_info' || die "/metrics has no lightwell_build_info"
if [ -e "$root/usr/share/lightwell/web/index.html" ]; then
    page 7781 / | head -n 1 | grep -q ' 200 ' || die "the browser client is not served"
else
    step "the browser client is left out: its npm packages are missing (scripts/deps.sh)"
fi
in_network "${as_nobody[@]}" lightwellctl light lamp off >"$work/ctl.log" 2>&1 || die "lightwellctl: $(cat "$work/ctl.log")"
in_network "${as_nobody[@]}" timeout 100 minimal 7780 0 6 0 2>&1 | head -n 2 >"$work/minimal.log" || true # it ends by SIGPIPE
grep -q 'W/m^2' "$work/minimal.log" || die "examples/minimal.c: $(cat "$work/minimal.log")"
kill -TERM "$server"
status=0
wait "$server" || status=$?
server=''
[ $status -eq 0 ] || die "the server ended with $status: $(cat "$work/server.log")"

# ---- removing ----

step "removing the packages"
rm "$root/usr/bin/minimal"
"${inside[@]}" apt-get purge -y lightwell liblightwell1 liblightwell-dev >>"$work/apt.log" 2>&1 ||
    die "apt-get purge: $(tail -n 30 "$work/apt.log")"
while read -r file; do
    [ ! -e "$root$file" ] || [ -d "$root$file" ] || die "$file is left"
done <"$work/files"
[ ! -e "$root/etc/lightwell" ] || die "/etc/lightwell is left"

step "passed: $(cd "$work/packages" && du -k ./*.deb | awk '{ sub("./", "", $2); printf "%s %.1f MB; ", $2, $1 / 1024 }')\
$(wc -l <"$work/files") files"
