#!/usr/bin/env bash
# Builds .venv from environment.txt and installs the project into it, editable.
#
#   tools/setup.sh [PYTHON]      PYTHON: a Python 3.11, 3.12 or 3.13 (default python3)
#
# What Debian or Ubuntu lacks for that, the venv module and Open3D's system libraries, is
# installed with apt (as root, or by sudo). Elsewhere the script stops with what to install.
# Run again it does only what is missing.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

python=${1:-python3}
venv=.venv

# What libOpen3D links to, and the Debian package that has it.
declare -A package_of=(
    [libEGL.so.1]=libegl1
    [libGL.so.1]=libgl1
    [libX11.so.6]=libx11-6
    [libidn2.so.0]=libidn2-0
    [libudev.so.1]=libudev1
    [libusb-1.0.so.0]=libusb-1.0-0
    [libstdc++.so.6]=libstdc++6
    [libgcc_s.so.1]=libgcc-s1
)

say() { printf 'setup: %s\n' "$*"; }
stop() { printf 'setup: %s\n' "$*" >&2; exit 1; }

check_python() {
    command -v "$python" >/dev/null ||
        stop "no '$python' here; name a Python 3.11-3.13: make setup PYTHON=python3.12"
    version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    case $version in
        3.11 | 3.12 | 3.13) ;;
        *) stop "'$python' is Python $version, the pinned packages need 3.11, 3.12 or 3.13;" \
            "name one: make setup PYTHON=python3.12" ;;
    esac
}

# Sets `missing_libraries`: what the dynamic loader does not find. Asks the loader itself, so it
# holds on any distribution and with LD_LIBRARY_PATH.
find_missing_libraries() {
    missing_libraries=$("$python" - "${!package_of[@]}" <<'EOF'
import ctypes, sys

for name in sorted(sys.argv[1:]):
    try:
        ctypes.CDLL(name)
    except OSError:
        print(name)
EOF
    )
}

# Sets `missing_packages`: the Debian packages to install. venv can be there without ensurepip.
find_missing_packages() {
    missing_packages=()
    "$python" -c 'import ensurepip, venv' 2>/dev/null || missing_packages+=("python$version-venv")
    find_missing_libraries
    local library
    for library in $missing_libraries; do missing_packages+=("${package_of[$library]}"); done
}

apt_install() {
    say "installing with apt: $*"
    "${as_root[@]}" apt-get update -qq || say "apt-get update failed, going on with the lists at hand"
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

install_system_packages() {
    find_missing_packages
    [ ${#missing_packages[@]} -gt 0 ] || return 0
    if ! command -v apt-get >/dev/null; then
        stop "this system lacks what Debian calls ${missing_packages[*]}" \
            "(shared libraries: ${missing_libraries//$'\n'/ }); install them, then run make setup again"
    fi
    as_root=()
    if [ "$(id -u)" != 0 ]; then
        # sudo may ask for a password only where somebody can type one.
        if ! command -v sudo >/dev/null || { [ ! -t 0 ] && ! sudo -n true 2>/dev/null; }; then
            stop "type this, then make setup again:" \
                "sudo apt-get update && sudo apt-get install -y ${missing_packages[*]}"
        fi
        as_root=(sudo)
    fi
    apt_install "${missing_packages[@]}"
    find_missing_packages
    [ ${#missing_packages[@]} -eq 0 ] ||
        stop "still missing after apt: ${missing_packages[*]} ${missing_libraries//$'\n'/ }"
}

make_venv() {
    local has
    has=$("$venv/bin/python" -c 'import pip, sys; print("%d.%d" % sys.version_info[:2])' \
        2>/dev/null) || has=none
    [ "$has" != "$version" ] || return 0
    say "creating $venv with Python $version"
    "$python" -m venv --clear "$venv"
}

install_packages() {
    local pip=("$venv/bin/python" -m pip --disable-pip-version-check install --progress-bar off)
    local total
    total=$(grep -c == environment.txt)
    say "installing the packages of environment.txt, about $total (a minute or two)"
    PYTHONUNBUFFERED=1 "${pip[@]}" -r environment.txt | awk -v total="$total" '
        /^Collecting/ && ++n % 20 == 0 { print "setup: " n " of about " total " found"; fflush() }
        /^Installing collected/ { print "setup: unpacking them"; fflush() }'
    say "installing the project, editable"
    "${pip[@]}" --quiet --no-deps --no-build-isolation -e .
    OPEN3D_DISABLE_WEB_VISUALIZER=true "$venv/bin/python" -c 'import open3d, paperrepro' ||
        stop "the packages are installed but do not import, see above"
}

check_python
install_system_packages
make_venv
install_packages
say "done: $venv is ready"
