#!/usr/bin/env bash
# Makes the pictures of docs/gallery/hoetzlein.md again: docs/gallery/shapes.sh [NAME...]. Needs Python with pillow; PYTHON names it. A few minutes a picture.
set -euo pipefail
cd "$(dirname "$0")/../.."
osier=${OSIER:-target/release/osier}
[ -n "${OSIER:-}" ] || cargo build --release --quiet
work=out/gallery-shapes
mkdir -p "$work"

# NAME SCENE FLAGS...: a picture in $work.
draw() {
    local name=$1 scene=$2
    shift 2
    "$osier" preview -q "scenes/$scene.toml" --search shapes -o "$work/$name.png" --force "$@"
}
# NAME WIDTH PICTURE...: pictures of $work side by side as docs/gallery/NAME.jpg, together WIDTH pixels wide.
strip() {
    "${PYTHON:-python3}" - "$work" "$@" <<'PY'
import sys
from PIL import Image

work, name, width, *pictures = sys.argv[1:]
pictures = [Image.open(f"{work}/{p}.png").convert("RGB") for p in pictures]
gap, one = 4, (int(width) - 4 * (len(pictures) - 1)) // len(pictures)
pictures = [p.resize((one, p.height * one // p.width), Image.LANCZOS) for p in pictures]
sheet = Image.new("RGB", (len(pictures) * (one + gap) - gap, pictures[0].height), "white")
for k, p in enumerate(pictures):
    sheet.paste(p, (k * (one + gap), 0))
sheet.save(f"docs/gallery/{name}.jpg", quality=88, optimize=True)
PY
}
# NAME SCENE FLAGS...: one picture, 600 pixels wide.
single() { draw "$@" --quality fine; strip "$1" 600 "$1"; }

bare="--set plants.tree.fill.levels=1 --set plants.tree.fill.leaf_spacing=0"
eye() { printf -- '--set camera.eye=[%s] --set camera.target=[%s]' "$1" "$2"; }

shapes-tree() { single shapes-tree tree --seed 3 --size 600x600; }
shapes-trunk() { single shapes-trunk filled-tree --seed 3 --size 600x600 $bare; }
twisted-tree() { single twisted-tree twisted-tree --seed 1 --size 600x600; }
turf() { single turf turf --size 600x450; }
medusa() { single medusa medusa --size 600x600; }
tumbleweed() { single tumbleweed tumbleweed --size 600x600; }
shapes-stages() {
    draw stage-a filled-tree --seed 3 --size 600x600 $bare --set plants.tree.skin.form=segments --set plants.tree.growth.step=4
    draw stage-b filled-tree --seed 3 --size 600x600 $bare
    draw stage-c filled-tree --seed 3 --size 600x600
    strip shapes-stages 900 stage-a stage-b stage-c
}
shapes-detail() {
    draw shapes-detail filled-tree --seed 3 --size 1200x800 $bare --sun 40,-40 $(eye 1.5,2.5,3.4 0,3.1,0)
    strip shapes-detail 600 shapes-detail
}
bush() { draw bush bush --size 900x900; strip bush 450 bush; }
vine-growth() {
    local f
    for f in 20 40 70 120; do draw "vine-$f" vine --frame $f --size 480x480; done
    strip vine-growth 900 vine-20 vine-40 vine-70 vine-120
}
shapes-seeds() {
    draw shapes-seeds tree --seeds 0-7 --columns 4 --size 400x400
    strip shapes-seeds 900 shapes-seeds
}

[ $# -gt 0 ] || set -- shapes-tree shapes-trunk shapes-stages twisted-tree turf shapes-detail medusa tumbleweed bush vine-growth shapes-seeds
for name in "$@"; do "$name"; done
