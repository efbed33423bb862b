#!/usr/bin/env bash
# Makes the pictures of catkins in flight again from bakes: docs/gallery/catkins.sh [tufts] [fig12] [fig13] [ground] [wall].
# The first two by Cycles, which takes hairs thinner than a pixel for what they are, the others by POV-Ray. Needs povray, ImageMagick and a
# Python with bpy (PYTHON=...); half an hour for all of them on two cores.
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
# NAME SCENE FRAME SUN FLAGS... -- FLAGS...: a frame of a bake by Cycles as $work/NAME.png; flags of the bake, then of the picture.
cycles() {
    local name=$1 scene=$2 frame=$3 sun=$4 flags=()
    shift 4
    while [ "$1" != -- ]; do flags+=("$1"); shift; done
    shift
    target/release/osier -q bake "$scene" -o "$work/$name" --formats usd --frames "$frame" "${flags[@]}"
    "${PYTHON:-python3}" docs/gallery/render.py "$work/$name/${scene//-/_}.usda" "$work/$name.png" --frame "$frame" --sun="$sun" "$@" > "$work/log" 2>&1 ||
        { cat "$work/log"; exit 1; }
}
from() { printf -- '--set camera.eye=[%s] --set camera.target=[%s]' "$1" "$2"; }
sheet() { montage "$work"/"$1"-*.png -tile "$2" -geometry +2+2 -quality 88 "docs/gallery/$3"; }

tufts() {
    cycles tufts catkins-ground 140 32,-75 -- --samples 96 --size 960x720 --eye=-0.30,0.17,0.5 --target=0.05,0.035,-0.12 --fov 33 --exposure 0.6
    convert "$work/tufts.png" -resize 800x600 docs/gallery/catkins-ground.png
}

fig12() {
    local day="--size 600x450 --samples 40 --exposure 0.4" blue="--exposure 0.35 --sky #7fa9dd,#2a5fae,#4a5a34"
    cycles fig12-a catkins-air 50 38,15 $(from 0.13,0.54,0.14 0.28,0.63,-0.24) -- $day $blue
    cycles fig12-b catkins-ground 140 36,-50 $(from -0.35,0.16,0.5 0.05,0.02,-0.1) -- $day
    cycles fig12-c catkins-wall 144 38,-120 -- $day
    cycles fig12-d catkins-air 30 38,15 $(from -0.45,0.75,1.3 0,1.0,0) -- $day $blue
    cycles fig12-e catkins-ground 96 36,-50 -- $day
    cycles fig12-f catkins-wall 100 38,-120 $(from -1.7,0.75,-1.9 0.75,0.4,0.1) -- $day
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

[ $# -gt 0 ] || set -- tufts fig12 fig13 ground wall
for name in "$@"; do "$name"; done
