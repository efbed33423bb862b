#!/bin/sh
# lbmpy and osier take steps of the same wind in turn: D3Q15, one relaxation time, numbers of 32 bits, vectorised, as many
# threads each. lbmpy in place (AA) and with two copies (pull), whose cells flow nowhere: no walls, no inlet, no outlet; and in
# place with faces like ours; osier with ground, inlet and outlet. Prints million cells a second.
# Asks for Python 3 with venv, gcc, and network for PyPI at the first run. Usage: benches/peers/lbmpy.sh [THREADS] [RUNS] [SIZES]
set -eu
cd "$(dirname "$0")/../.."
threads=${1:-2}
runs=${2:-5}
sizes=${3:-70,128,192}
venv=target/lbmpy
if [ ! -e "$venv/ready" ]; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install -q lbmpy==2.0 pystencils==2.0
    touch "$venv/ready"
fi
cargo build --release --quiet --bench lattice
bench=$(ls -t target/release/deps/lattice-* | grep -v '\.d$' | head -1)
i=0
while [ "$i" -lt "$runs" ]; do
    for n in $(echo "$sizes" | tr ',' ' '); do
        "$venv/bin/python" benches/peers/lbmpy_steps.py "$threads" "$n" 1
        RAYON_NUM_THREADS=$threads "$bench" "$n"
    done
    i=$((i + 1))
done
