#!/bin/sh
# flam3 and osier draw the same fern in turn: 48 points a pixel of 2048 x 2048 (201 million), in colour, one thread each, whole
# programs with the writing of the PNG. Prints CPU and wall seconds of each run.
# Asks for flam3-render (Debian: flam3-utils), GNU time and a release build of osier. Usage: benches/peers/flames.sh [RUNS]
set -eu
cd "$(dirname "$0")/../.."
osier=${OSIER:-target/release/osier}
side=2048
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

# The system as osier writes it, with size and scale of the picture, no filter, no density estimation, and a palette.
"$osier" grow fern_leaf -o "$folder/fern.flame" >/dev/null
sed -i -e "s|size=\"[^\"]*\"|size=\"$side $side\" quality=\"48\" supersample=\"1\" filter=\"0.1\" estimator_radius=\"0\" temporal_samples=\"1\"|" \
    -e 's|scale="[^"]*"|scale="193"|' -e 's|</flame>|<color index="0" rgb="40 160 60"/><color index="255" rgb="200 220 90"/></flame>|' \
    "$folder/fern.flame"

timed() {
    name=$1
    shift
    /usr/bin/time -o "$folder/time" -f "$name %U CPU s, %e wall s" "$@" >/dev/null 2>&1
    cat "$folder/time"
}
i=0
while [ "$i" -lt "${1:-3}" ]; do
    timed flam3 env nthreads=1 isaac_seed=1 out="$folder/flam3.png" sh -c "exec flam3-render <$folder/fern.flame"
    timed osier env RAYON_NUM_THREADS=1 "$osier" grow fern_leaf -o "$folder/osier.png" --force --set color_by=palette \
        --set picture.width=$side --set picture.height=$side --set picture.points=$((48 * side * side))
    i=$((i + 1))
done
[ -z "${KEEP:-}" ] || cp "$folder"/*.png "$KEEP"
