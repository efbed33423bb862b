#!/usr/bin/env bash
# Makes the pictures of catkins in flight again, by POV-Ray from bakes: docs/gallery/catkins.sh [fig12] [fig13] [ground] [wall].
# Needs povray and ImageMagick; a quarter of an hour for all of them on two cores.
set -euo pipefail
cd "$(dirname "$0")/../.."
cargo build --release --quiet
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# NAME SCENE FRAMES WIDTHxHEIGHT FLAGS...: frames of a bake as $work/NAME*.png
draw() {
    local name=$1 scene=$2 frames=$3 size=$4
    shift 4
    target/release/osier -q bake "$scene" -o "$work/$name" --formats pov --frames "$frames" "$@"
    (cd "$work/$name/pov" && povray render.ini +W"${size%x*}" +H"${size#*x}" +A0.1 +FN8 +O"$work/$name.png") 2> "$work/log" ||
        { cat "$work/log"; exit 1; }
}
from() { printf -- '--set camera.eye=[%s] --set camera.target=[%s]' "$1" "$2"; }
sheet() { montage "$work"/"$1"-*.png -tile "$2" -geometry +2+2 -quality 88 "docs/gallery/$3"; }

fig12() {
    local one=480x360
    draw fig12-a catkins-air 50-50 $one $(from 0.13,0.54,0.14 0.28,0.63,-0.24)
    draw fig12-b catkins-ground 140-140 $one $(from -0.35,0.16,0.5 0.05,0.02,-0.1)
    draw fig12-c catkins-wall 144-144 $one
    draw fig12-d catkins-air 30-30 $one $(from -0.45,0.75,1.3 0,1.0,0)
    draw fig12-e catkins-ground 96-96 $one
    draw fig12-f catkins-wall 100-100 $one $(from -1.7,0.75,-1.9 0.75,0.4,0.1)
    sheet fig12 3x2 catkins-fig12.jpg
}

fig13() {
    local one=480x360 n
    for n in 500 1000 2000; do
        draw "fig13-$(printf %04d $n)" catkins-sky 120-120 $one --set flight.count=$n
    done
    sheet fig13 3x1 catkins-fig13.jpg
}

# NAME: every third frame of catkins-NAME as a clip.
clip() {
    target/release/osier -q bake "catkins-$1" -o "$work/$1" --formats pov
    for frame in $(seq 1 3 144); do
        (cd "$work/$1/pov" && povray render.ini +W400 +H300 +A0.1 +FN8 +SF"$frame" +EF"$frame" +O"$work/$1-.png") 2> "$work/log"
    done
    convert -delay 12 -loop 0 "$work/$1"-*.png +dither -colors 64 +map -layers optimize-frame "docs/gallery/catkins-$1.gif"
}
ground() { clip ground; }
wall() { clip wall; }

[ $# -gt 0 ] || set -- fig12 fig13 ground wall
for name in "$@"; do "$name"; done
