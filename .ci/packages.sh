# The one list of Debian packages, and how they come onto a machine. Sourced by quickstart, test, .ci/run and
# docker/verify; the container's build reads the same list: bash .ci/packages.sh list GROUP...

source "$(dirname "${BASH_SOURCE[0]}")/shell.sh"

packages_of() {
    case $1 in
        build) echo g++ cmake ninja-build pkg-config \
            libcpp-httplib-dev nlohmann-json3-dev libeigen3-dev libnanoflann-dev libdraco-dev libspdlog-dev \
            libmeshoptimizer-dev libcairo2-dev fonts-dejavu-core libtbb-dev libsqlite3-dev zlib1g-dev libbrotli-dev libssl-dev libcurl4-openssl-dev libcli11-dev prometheus-cpp-dev libseccomp-dev libyaml-cpp-dev libgtest-dev ;;
        viewer) echo nodejs npm ca-certificates ;;
        test) echo chromium ;;
        container) echo debootstrap buildah podman runc curl ;;
        *) echo "packages: no group '$1'" >&2; return 2 ;;
    esac
}

# need GROUP...: installs what is missing of these groups, and says so in one line. Silent when nothing is.
need() {
    local group package missing=()
    for group in "$@"; do
        for package in $(packages_of "$group"); do
            already_here "$package" || missing+=("$package")
        done
    done
    ((${#missing[@]})) || return 0

    if ! command -v apt-get >/dev/null; then
        say "This is no Debian: what stands for these packages must be there already: ${missing[*]}"
        return 0
    fi
    local as_root=()
    if ((EUID != 0)); then
        command -v sudo >/dev/null || fail "root is needed once, and there is no sudo: apt-get install ${missing[*]}"
        as_root=(sudo)
    fi
    say "Installing ${#missing[@]} Debian packages: ${missing[*]}"
    # Lists may be absent (a fresh container) or stale (an address that is gone): the second try is with new ones.
    local log=build/packages.log
    mkdir -p build
    if ! { apt_install "${missing[@]}" || { "${as_root[@]}" apt-get update -qq && apt_install "${missing[@]}"; }; } \
            >"$log" 2>&1 </dev/null; then
        tail -n 20 "$log" >&2
        fail "apt-get could not install them; the whole of it is in $log"
    fi
}

apt_install() {
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends \
        -o DPkg::Lock::Timeout=300 "$@"
}

# A Node.js from elsewhere (nodesource, nvm) brings its own npm and clashes with Debian's: what is on PATH is enough.
already_here() {
    case $1 in
        nodejs) command -v node >/dev/null && return ;;
        npm) command -v npm >/dev/null && return ;;
        clang) command -v clang++ >/dev/null && return ;;
    esac
    [[ $(dpkg-query -W -f='${db:Status-Status}' "$1" 2>/dev/null) == installed ]]
}

if [[ ${BASH_SOURCE[0]} == "$0" && ${1-} == list ]]; then
    for group in "${@:2}"; do packages_of "$group"; done
fi
