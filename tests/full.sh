#!/usr/bin/env bash
# What takes longer than the gate: every seed of every preset, debug against release, masked instruction sets.
# Run it before calling a change to growth, surface or export done.
set -euo pipefail
cd "$(dirname "$0")/.."
bash tests/all.sh
say() { printf '\n== %s\n' "$*"; }

say "licences, sources and duplicates of the dependencies"
# The database of advisories is not part of this: it changes without a change here.
cargo deny --version >/dev/null 2>&1 || cargo install -q cargo-deny@0.20.2 --locked
cargo deny check bans licenses sources

say "the serial build is clean, and one thread without the program"
cargo clippy --release --no-default-features --features cli --lib --bins -- -D warnings
cargo clippy --release --no-default-features --lib -- -D warnings

say "the library is clean without the program"
cargo clippy --release --no-default-features --features parallel --lib -- -D warnings

say "the serial build passes the same tests, snapshots of bytes among them"
cargo test --release --no-default-features --lib --quiet

say "Blender 4.5.15 (LTS) opens what 5.0.1 opens"
lts=target/clients/venv-lts
if [ ! -e "$lts/ready" ]; then
    python3.11 -m venv "$lts"
    sed 's/^bpy==.*/bpy==4.5.15/' tests/clients/requirements.txt | "$lts/bin/pip" install -q --disable-pip-version-check -r /dev/stdin
    touch "$lts/ready"
fi
# The modules of tests that run a script with bpy.
OSIER_BPY="$lts/bin/python" cargo test --release --workspace --test it -- attractors:: blender_import:: blender_panel:: clips:: \
    copies:: flights:: gltf_blender:: grown_trees:: maps:: morphs:: particle_shapes:: points:: presets_in_clients:: rain_charts:: rain_files:: \
    showcase:: sway:: tracks:: usd_stages:: vdb::

say "every preset at seeds 0 to 63"
OSIER_SEEDS=64 cargo test --release --test it presets -- --nocapture

say "walls and wet ground at eight seeds"
OSIER_SEEDS=8 cargo test --release --test it flights::

say "what takes from half a minute to minutes each: imports, growth, flows, stands"
cargo test --release --workspace --test it -- --ignored
cargo test --release --workspace --lib -- --ignored

say "the same bytes from debug, release and without the newer instruction sets"
cargo build --quiet
cargo build --quiet --release
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
./target/debug/osier -q bake --frames 1-3 -o "$work/debug" showcase
./target/release/osier -q bake --frames 1-3 -o "$work/release" showcase
GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-FMA ./target/release/osier -q bake --frames 1-3 -o "$work/masked" showcase
TZ=Asia/Tokyo LC_ALL=de_DE.UTF-8 ./target/release/osier -q -j1 bake --frames 1-3 -o "$work/serial" showcase
for other in release masked serial; do
    diff -r "$work/debug" "$work/$other"
    echo "debug and $other: equal"
done
