#!/usr/bin/env bash
# Makes the pictures of rain again from bakes, by POV-Ray: docs/gallery/rain.sh [fig14] [fig1] [wet] [pendant].
# Needs POV-Ray 3.7 and ImageMagick; a quarter of an hour for all of them on two cores.
set -euo pipefail
cd "$(dirname "$0")/../.."
cargo build --release --quiet
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# NAME SCENE FRAMES SIZE FLAGS...: frames (a,b,c or a-b:step) of a bake as $work/NAME-0001.png ...; flags of the bake.
render() {
    local name=$1 scene=$2 frames=$3 size=$4 frame
    shift 4
    target/release/osier -q bake "$scene" -o "$work/$name" --formats pov --frames "$frames" "$@"
    for frame in $(ls "$work/$name/pov/frames" | sed 's/[^0-9]//g'); do
        (cd "$work/$name/pov" && povray render.ini +KFI$((10#$frame)) +KFF$((10#$frame)) +W"${size%x*}" +H"${size#*x}" -D \
            +O"$work/$name-.png") > "$work/log" 2>&1 || { cat "$work/log"; exit 1; }
        mv "$work/$name-$((10#$frame)).png" "$work/$name-$frame.png"
    done
}
# EYE TARGET ANGLE: from where.
from() { printf -- '--set camera.eye=[%s] --set camera.target=[%s] --set camera.vfov_deg=%s' "$1" "$2" "$3"; }

fig14() {
    render a wet-leaf 2 560x420 $(from -0.010,0.303,0.068 -0.0205,0.2717,0.006 17)
    render b wet-leaf 44 560x420 $(from 0.004,0.299,0.074 -0.008,0.263,0.006 28)
    render c wet-leaf 44 560x420 $(from -0.053,0.279,0.070 -0.062,0.2565,0.006 22)
    render d wet-leaf 44 560x420 $(from 0.017,0.248,0.068 0.012,0.2365,0.006 20)
    montage -label 'at rest' "$work/a-0002.png" -label 'a wet way' "$work/b-0044.png" -label 'flattened by its weight' "$work/c-0044.png" \
        -label 'hanging' "$work/d-0044.png" -tile 2x2 -geometry +3+3 -pointsize 18 -quality 88 docs/gallery/rain-fig14.jpg
}

fig1() {
    render fig1 rain-leaves 86,88,90,92,98,104 560x420
    montage "$work"/fig1-*.png -tile 3x2 -geometry +2+2 -quality 87 docs/gallery/rain-fig1.jpg
}

wet() {
    render wet wet-leaf 44 960x720
    convert "$work/wet-0044.png" -depth 8 -quality 90 docs/gallery/wet-leaf.jpg
}

pendant() {
    render pendant wet-leaf 56-82 240x300 $(from 0.016,0.247,0.081 0.012,0.231,0.006 34)
    convert -delay 8 -loop 0 "$work"/pendant-*.png -dither FloydSteinberg -colors 224 +map -layers optimize docs/gallery/rain-pendant.gif
}

[ $# -gt 0 ] || set -- fig14 fig1 wet pendant
for name in "$@"; do "$name"; done
