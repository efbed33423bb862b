#!/usr/bin/env bash
# Installs the real programs that judge our files, then runs every test.
# Where one of them cannot be installed it says which checks are skipped and goes on.
set -euo pipefail
cd "$(dirname "$0")/.."

say() { printf '\n== %s\n' "$*"; }

bash tests/clients.sh
if grep -q . target/clients/missing; then
    say "SKIPPED for want of a client: $(grep . target/clients/missing | paste -sd ';')"
else
    export OSIER_JUDGES=require
fi

# A third test runs while others wait for a program that takes one core.
cores=$(nproc 2>/dev/null || echo 2)
export RUST_TEST_THREADS=${RUST_TEST_THREADS:-$((cores + (cores + 1) / 2))}

say "unit, property, snapshot, golden and real-client tests"
# With the whole workspace, so that the wheel is built of the crates that the tests are built of.
cargo test --release --workspace --no-fail-fast
