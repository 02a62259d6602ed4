#!/usr/bin/env bash
# Sets up .venv: the locked Python packages, the system libraries they need, and the Rust kernels.
#
#   scripts/setup.sh            all three
#   scripts/setup.sh packages   the Python packages alone
#   scripts/setup.sh browser    all three, and a browser for the tests of the page
#
# What a step was made from is kept as a hash next to its result, so a second run takes a fraction of a second.
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD
venv=$root/.venv
log=$root/.tools/setup.log
wanted=${1:-all}
python=${PYTHON:-python3}

mkdir -p .tools
if command -v flock >/dev/null; then exec 9>.tools/setup.lock && flock 9; fi

# One plain line, and out.
stop() {
    printf '%s\n' "$*" >&2
    exit 2
}

# step LABEL COMMAND...: one line with the seconds it took; the end of its output if it failed.
step() {
    local label=$1 started=$SECONDS ticker="" rc=0
    shift
    printf '%s …' "$label"
    if [ -t 1 ]; then
        while sleep 1; do printf '\r%s … %d s' "$label" $((SECONDS - started)); done 9>&- &
        ticker=$!
        trap 'kill "$ticker" 2>/dev/null || true' EXIT
    fi
    ("$@") >>"$log" 2>&1 </dev/null 9>&- || rc=$?
    if [ -n "$ticker" ]; then
        kill "$ticker" 2>/dev/null || true
        wait "$ticker" 2>/dev/null || true
        trap - EXIT
        printf '\r%s …' "$label"
    fi
    if [ "$rc" -ne 0 ]; then
        printf ' failed. The end of %s:\n\n' "${log#"$root"/}"
        tail -n 40 "$log"
        exit "$rc"
    fi
    printf ' %d s\n' $((SECONDS - started))
}

hash_of() {
    if command -v sha256sum >/dev/null; then sha256sum; else shasum -a 256; fi | cut -d ' ' -f 1
}

may_apt() {
    [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null
}

# Installs Debian packages where it may, else names the command that does.
apt_install() {
    may_apt || stop "Missing: $1. Install with: sudo apt-get install --yes ${*:2}"
    export DEBIAN_FRONTEND=noninteractive
    apt-get install --yes --no-install-recommends "${@:2}" && return
    apt-get update && apt-get install --yes --no-install-recommends "${@:2}"
}

check_tools() {
    command -v "$python" >/dev/null ||
        stop "Python ≥ 3.11 is needed, and there is no $python. On Debian: apt-get install python3 python3-venv"
    "$python" -I -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
        stop "Python ≥ 3.11 is needed, and $python is $("$python" -V 2>&1). Name another: make PYTHON=python3.12 …"
    command -v cargo >/dev/null ||
        stop "The Rust toolchain is missing (no cargo). Get it from https://rustup.rs and open a new shell."
    command -v cc >/dev/null ||
        stop "A C compiler is missing (Rust links with it). On Debian: apt-get install build-essential"
    local rust_wanted rust_here
    rust_wanted=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
    rust_here=$(rustc --version | cut -d ' ' -f 2)
    [ "$(printf '%s\n' "$rust_wanted" "$rust_here" | sort -V | head -n 1)" = "$rust_wanted" ] ||
        stop "Rust ≥ $rust_wanted is needed, and rustc is $rust_here. Run: rustup update stable"
}

# The environment is made again only for another interpreter or in another place: its scripts name both.
make_venv() {
    local key
    key="$root $("$python" -c 'import sys; print(sys.base_prefix, sys.version)')"
    rm -f "$venv"/.made-packages "$venv"/.made-kernels
    if ! is_current venv "$key" || ! "$venv/bin/python" -m pip --version; then
        rm -rf "$venv"
        "$python" -m venv "$venv" || return
        echo "$key" >"$venv/.made-venv"
    fi
}

install_packages() {
    # uv, at the version and hash of the lock, does in seconds what takes pip a minute; pip does it where uv cannot.
    awk '/^uv==/ { on = 1 } on { print } on && !/\\$/ { exit }' requirements.lock >.tools/uv.lock
    "$venv/bin/python" -m pip install --disable-pip-version-check --require-hashes --no-deps -r .tools/uv.lock
    UV_SYSTEM_CERTS=1 "$venv/bin/uv" pip sync --no-config --require-hashes --python "$venv/bin/python" \
        requirements.lock ||
        "$venv/bin/python" -m pip install --disable-pip-version-check --require-hashes -r requirements.lock
}

# The shared libraries that SUMO and the readers of maps ask of the system and do not find.
missing_libraries() {
    command -v ldd >/dev/null || return 0
    local site
    site=$("$venv/bin/python" -I -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
    { ldd "$site"/sumo/bin/* "$site"/libsumo/*.so "$site"/osmium/*.so 2>/dev/null || true; } |
        awk '/not found/ && /=>/ { print $1 }' | sort -u
}

# The Debian package of each library that the wheels take from the system.
package_of() {
    case $1 in
    libGL.so.1) echo libgl1 ;;
    libX11.so.6) echo libx11-6 ;;
    libXext.so.6) echo libxext6 ;;
    libXrender.so.1) echo libxrender1 ;;
    libatomic.so.1) echo libatomic1 ;;
    libexpat.so.1) echo libexpat1 ;;
    libstdc++.so.6) echo libstdc++6 ;;
    libxcb.so.1) echo libxcb1 ;;
    libz.so.1) echo zlib1g ;;
    esac
}

install_libraries() {
    local missing packages=() package library
    missing=$(missing_libraries)
    for library in $missing; do
        package=$(package_of "$library")
        [ -z "$package" ] || packages+=("$package")
    done
    [ "${#packages[@]}" -eq 0 ] || apt_install "${missing//$'\n'/ }" "${packages[@]}"
    missing=$(missing_libraries)
    [ -z "$missing" ] || stop "SUMO's shared libraries are still missing: ${missing//$'\n'/ }"
}

# Whether anything here can draw: a graphics card or Mesa's software Vulkan. Everything but frames works without.
has_adapter() {
    XDG_RUNTIME_DIR=${XDG_RUNTIME_DIR:-/tmp} "$venv/bin/python" -I - <<'PYTHON' >>"$log" 2>&1
import sys

import wgpu
from wgpu.backends.wgpu_native.extras import set_instance_extras

set_instance_extras(backends=("Vulkan", "Metal", "DX12"))
sys.exit(not wgpu.gpu.enumerate_adapters_sync())
PYTHON
}

install_adapter() {
    apt_install "a Vulkan adapter" mesa-vulkan-drivers || true
    has_adapter || echo "Installed mesa-vulkan-drivers, and still no adapter answers: frames will not be drawn."
}

has_browser() {
    command -v chromium || command -v chromium-browser || command -v google-chrome
}

install_browser() {
    apt_install "a browser" chromium || true # without one the tests that need it are skipped
}

# What `maturin develop --release --locked` does, less its own look at the index for packages that are here already.
build_kernels() {
    PATH=$venv/bin:$PATH "$venv/bin/python" -m pip install --disable-pip-version-check --verbose \
        --no-index --no-deps --no-build-isolation --editable .
}

packages_key() {
    { echo "$root" && "$python" -c 'import sys; print(sys.base_prefix, sys.version)' &&
        cat requirements.lock scripts/setup.sh; } | hash_of
}

kernels_key() {
    { packages_key && find Cargo.toml Cargo.lock pyproject.toml crates -type f | LC_ALL=C sort |
        xargs cat; } | hash_of
}

is_current() { # is_current STEP KEY
    [ -x "$venv/bin/python" ] && [ "$(cat "$venv/.made-$1" 2>/dev/null)" = "$2" ]
}

check_tools
: >"$log"

key=$(packages_key)
if ! is_current packages "$key"; then
    if ! "$python" -I -c 'import ensurepip, venv' 2>/dev/null; then
        may_apt || stop "Python's venv module is missing. On Debian: sudo apt-get install --yes python3-venv"
        step "[0/3] Python's venv module, by apt" apt_install venv python3-venv
    fi
    step "[1/3] Python packages" eval 'make_venv && install_packages'
    echo "$key" >"$venv/.made-packages"
fi
[ "$wanted" != packages ] || exit 0

if ! is_current libraries "$key"; then
    if [ -n "$(missing_libraries)" ] && ! may_apt; then install_libraries; fi
    step "[2/3] System libraries" install_libraries
    if ! has_adapter; then
        if may_apt; then
            step "[2/3] A Vulkan adapter in software, by apt" install_adapter
        else
            echo "No Vulkan adapter: frames will not be drawn, all else works. On Debian or Ubuntu:"
            echo "  sudo apt-get install --yes mesa-vulkan-drivers"
        fi
    fi
    echo "$key" >"$venv/.made-libraries"
fi

key=$(kernels_key)
if ! is_current kernels "$key" || ! ls src/pavetwin/_core*.so >/dev/null 2>&1; then
    step "[3/3] Rust kernels (a minute or two the first time)" build_kernels
    echo "$key" >"$venv/.made-kernels"
fi

if [ "$wanted" = browser ] && ! has_browser >/dev/null; then
    if may_apt; then
        step "A browser for the tests of the page, by apt" install_browser
    else
        echo "No browser: the tests of the page in a browser are skipped. On Debian or Ubuntu:"
        echo "  sudo apt-get install --yes chromium"
    fi
fi
