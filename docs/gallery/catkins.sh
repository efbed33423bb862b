#!/usr/bin/env bash
# Makes the pictures of catkins in flight again from bakes: docs/gallery/catkins.sh [tufts] [fig12] [fig13] [ground] [wall].
# By Cycles, which takes hairs thinner than a pixel for what they are. Needs ImageMagick and a Python with bpy (PYTHON=...); an hour for
# all of them on two cores.
set -euo pipefail
cd "$(dirname "$0")/../.."
cargo build --release --quiet
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

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
    local n
    for n in 500 1000 2000; do
        cycles "fig13-$(printf %04d $n)" catkins-sky 120 38,-120 --set flight.count=$n -- --size 480x360 --samples 40 --exposure 0.35 \
            --sky "#7fa9dd,#2a5fae,#4a5a34"
    done
    sheet fig13 3x1 catkins-fig13.jpg
}

# NAME SUN FLAGS...: every third frame of catkins-NAME as a clip.
clip() {
    local name=$1 sun=$2
    shift 2
    target/release/osier -q bake "catkins-$name" -o "$work/$name" --formats usd
    "${PYTHON:-python3}" docs/gallery/render.py "$work/$name/catkins_$name.usda" "$work/$name-.png" --frame 1 --until 144 --every 3 --sun="$sun" \
        --size 480x360 --samples 24 "$@" > "$work/log" 2>&1 || { cat "$work/log"; exit 1; }
    convert -delay 12 -loop 0 "$work/$name"-*.png +dither -colors 96 +map -layers optimize-frame "docs/gallery/catkins-$name.gif"
}
ground() { clip ground 36,-50 --exposure 0.4; }
wall() { clip wall 38,-120 --exposure 0.4 --size 400x300 --samples 10; }

[ $# -gt 0 ] || set -- tufts fig12 fig13 ground wall
for name in "$@"; do "$name"; done
