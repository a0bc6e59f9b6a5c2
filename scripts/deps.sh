#!/bin/bash
# Installs the Debian 12 packages that lightwell is built from, and the npm packages of its browser client. Does nothing, and
# needs no network, when all are there.
# scripts/deps.sh          what a build and the fast tests need
# scripts/deps.sh --all    and the sanitizers, fuzzers, formatters and other processors of the long tests
set -euo pipefail

packages=(
    gcc g++ libc6-dev cmake ninja-build pkg-config make git
    libembree-dev libtbb-dev libuv1-dev libssl-dev libwebsockets-dev libwebsockets-evlib-uv
    libnats-dev nats-server # nats-server is for tests alone, which start their own
    libprotobuf-c-dev protobuf-c-compiler protobuf-compiler
    libzstd-dev libxxhash-dev libjansson-dev libinih-dev
    libopenexr-dev libpng-dev libjpeg62-turbo-dev libassimp-dev libstb-dev libsdl2-dev
    libmeshoptimizer-dev libdraco-dev libwebp-dev libavif-dev # compressed glTF
    libepoxy-dev libegl-dev libegl1 libgl1-mesa-dri
    gnuplot-nox
    libcmocka-dev
    doxygen # the reference of liblightwell
    clang lld wasi-libc libclang-rt-14-dev-wasm32 # the browser client's tile decoder
    chromium-headless-shell # the tests of the browser client; chromium does in its place
    nginx-light caddy # the proxies of docs/access.md, which its tests start
)
# Node.js may have come from elsewhere, with a npm of its own.
if ! command -v node >/dev/null || ! command -v npm >/dev/null; then packages+=(nodejs npm ca-certificates); fi
long_packages=(
    clang libomp-14-dev libclang-rt-14-dev clang-format
    gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user
    chromium # the browser client's long tests, in a browser with windows
    firefox-esr xvfb # the browser client's other browser, which has WebGL on a display alone
    systemd prometheus # systemd-analyze and promtool: what the service's unit and metrics are checked with
)
if [ "${1:-}" = --all ]; then packages+=("${long_packages[@]}"); fi

if ! command -v dpkg-query >/dev/null; then
    echo "deps: this is no Debian system; please install what these Debian 12 packages hold: ${packages[*]}" >&2
    exit 69
fi

missing=()
for package in "${packages[@]}"; do
    state=$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null || true)
    [ "$state" = installed ] || missing+=("$package")
done

install_missing() {
    local as_root=()
    if [ "$(id -u)" -ne 0 ]; then
        if ! command -v sudo >/dev/null; then
            echo "deps: missing packages; as root, run: apt-get install ${missing[*]}" >&2
            exit 77
        fi
        as_root=(sudo)
    fi
    echo "deps: installing ${#missing[@]} Debian packages: ${missing[*]}" >&2
    # The proxies and nats-server are for tests alone, which start their own: no service of theirs begins, now or at a restart.
    local policy=/usr/sbin/policy-rc.d proxies=()
    for package in nginx-light caddy nats-server; do
        if [[ " ${missing[*]} " = *" $package "* ]]; then proxies+=("${package%-light}.service"); fi
    done
    if [ ${#proxies[@]} -gt 0 ] && [ ! -e $policy ]; then
        printf '#!/bin/sh\nexit 101\n' | "${as_root[@]}" install -m 755 /dev/stdin $policy
        trap "${as_root[*]} rm -f $policy" EXIT
    fi
    "${as_root[@]}" apt-get update
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "${missing[@]}" ||
        return
    if [ ${#proxies[@]} -gt 0 ] && command -v systemctl >/dev/null; then
        "${as_root[@]}" systemctl disable --quiet "${proxies[@]}" || true
    fi
}
if [ "${missing[*]}" = chromium-headless-shell ] && [ -x /usr/bin/chromium ]; then
    install_missing || echo "deps: chromium-headless-shell is missing; the tests take chromium, and twice as long" >&2
elif [ ${#missing[@]} -gt 0 ]; then
    install_missing
fi

# npm_packages FOLDER WHAT OTHERWISE
npm_packages() {
    if [ ! -e "$1/package-lock.json" ] || [ "$1/node_modules/.package-lock.json" -nt "$1/package-lock.json" ]; then return; fi
    echo "deps: installing the npm packages of $2" >&2
    (cd "$1" && npm ci --ignore-scripts --loglevel=error >&2) || echo "deps: npm could not fetch them; $3" >&2
}
web=$(dirname "$0")/../client/web
npm_packages "$web" 'the browser client' 'the browser client will be left out'
if [ "${1:-}" = --all ]; then
    npm_packages "$web/test/bundlers" 'the bundlers of the long tests' 'lightwell-three is not tested with them'
fi
