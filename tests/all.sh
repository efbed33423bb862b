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

say "unit, property, snapshot, golden and real-client tests"
# With the whole workspace, so that the wheel is built of the crates that the tests are built of.
cargo test --release --workspace --no-fail-fast
