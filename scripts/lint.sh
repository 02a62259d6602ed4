#!/usr/bin/env bash
# Runs every checker, so that one run shows everything that must be fixed. Exit code 1 if any of them complained.
set -uo pipefail
cd "$(dirname "$0")/.." || exit
failed=()

check() { # check NAME COMMAND...
    local name=$1
    shift
    printf '%-14s ' "$name"
    if output=$("$@" 2>&1); then
        echo ok
    else
        printf 'failed\n%s\n\n' "$output"
        failed+=("$name")
    fi
}

for part in clippy fmt; do
    cargo "$part" --version >/dev/null 2>&1 || {
        echo "cargo $part is missing. Run: rustup component add clippy rustfmt" >&2
        exit 2
    }
done

check "ruff check" .venv/bin/ruff check .
check "ruff format" .venv/bin/ruff format --check .
check "mypy --strict" .venv/bin/mypy
check "cargo clippy" cargo clippy --quiet --workspace --all-targets --locked -- -D warnings
check "cargo fmt" cargo fmt --check

if [ "${#failed[@]}" -gt 0 ]; then
    echo "Complaints from: ${failed[*]}" >&2
    exit 1
fi
