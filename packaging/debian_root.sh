# shellcheck shell=bash
# A root folder of Debian 12. docker/test.sh, docker/test_relays.sh and packaging/test.sh read this file.

# make_debian_root FOLDER TARGET OPTION...: TARGET, as small as can be, from this machine's apt sources and by its
# proxies; OPTIONs go to mmdebstrap. FOLDER takes lists and a log. Fails with a line on stderr.
make_debian_root() {
    local folder=$1 target=$2 certificates=()
    shift 2
    # shellcheck disable=SC2016 # apt's variables
    if ! apt-get indextargets --format 'deb $(REPO_URI) $(RELEASE) $(COMPONENT)' \
        'Created-By: Packages' 'Origin: Debian' |
        grep -E ' bookworm(-[a-z]+)? ' | sort -u >"$folder/sources.list"; then
        echo "apt knows no source of Debian 12 (bookworm) here: apt-get update" >&2
        return 1
    fi
    apt-config dump | grep -E '^Acquire::(http|https|Check-Date|Check-Valid-Until)' >"$folder/apt.conf" || true
    if grep -q ' https:' "$folder/sources.list"; then
        # shellcheck disable=SC2016 # the hook's variable
        certificates=('--setup-hook=cp --parents /etc/ssl/certs/ca-certificates.crt "$1"')
    fi
    # usr-is-merged stands in for a package that wants perl
    if ! mmdebstrap --quiet --variant=minbase --aptopt="$folder/apt.conf" "${certificates[@]}" \
        --include=usr-is-merged --hook-dir=/usr/share/mmdebstrap/hooks/merged-usr "$@" \
        bookworm "$target" - <"$folder/sources.list" >"$folder/mmdebstrap.log" 2>&1; then
        echo "mmdebstrap: $(cat "$folder/mmdebstrap.log")" >&2
        return 1
    fi
}

# unmount_below FOLDER: all that is mounted in it, the innermost first
unmount_below() {
    findmnt --noheadings --output TARGET --raw | grep -F "$1/" | sort -r |
        xargs --no-run-if-empty umount --lazy || true
}
