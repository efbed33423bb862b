#!/usr/bin/env bash
# Makes the pictures of docs/gallery/grammars.md again: docs/gallery/grammars.sh [NAME...]. Without names also the sheet of all of them. Needs Python with pillow;
# PYTHON names it. Some seconds a picture.
set -euo pipefail
cd "$(dirname "$0")/../.."
osier=${OSIER:-target/release/osier}
[ -n "${OSIER:-}" ] || cargo build --release --quiet
work=out/gallery-grammars
mkdir -p "$work"
wanted=" $* "
names=()

# NAME SOURCE FLAGS...: docs/gallery/grammar-NAME.jpg.
draw() {
    local name=$1 source=$2
    shift 2
    names+=("$name")
    if [ "$wanted" = "  " ] || [[ "$wanted" == *" $name "* ]]; then
        "$osier" preview -q "$source" --size 400x400 --quality "${QUALITY:-fine}" -o "$work/$name.png" --force "$@"
        "${PYTHON:-python3}" - "$work/$name.png" "docs/gallery/grammar-$name.jpg" <<'PY'
import sys
from PIL import Image

Image.open(sys.argv[1]).convert("RGB").save(sys.argv[2], quality=87, optimize=True)
PY
    fi
}
eye() { printf -- '--set camera.eye=[%s] --set camera.target=[%s]' "$1" "$2"; }
studio="--set ground.show=false"

draw daisy daisy --seed 1 $studio $(eye 0.3,0.52,0.36 0,0.27,0)
draw campion campion --seed 1 $studio $(eye 0.5,0.76,0.66 0.02,0.47,0)
draw lily-of-the-valley lily-of-the-valley --seed 1 $studio $(eye 0.22,0.22,0.36 0,0.13,0)
draw cow-parsley cow-parsley --seed 1 $studio $(eye 0.68,1.1,0.8 0,0.74,0)
draw oat oat --seed 2 $studio $(eye 0.9,0.95,1.18 0,0.66,0)
draw shepherds-purse shepherds-purse --seed 1 $studio $(eye 0.3,0.42,0.36 0,0.26,0)
draw mint mint --seed 1 $studio $(eye 0.4,0.66,0.46 0,0.42,0)
draw honeysuckle honeysuckle --seed 1 $studio $(eye 0.75,1.0,1.0 0,0.76,0)
draw fern fern --seed 1 $studio $(eye 0.75,0.75,0.95 0,0.22,0)
draw maidenhair maidenhair --seed 1 $studio
draw moss moss --seed 1 $studio $(eye 0.125,0.09,0.15 0,0.034,0)
draw compound-leaf compound-leaf --seed 1 $studio --view front
draw oak oak
draw birch birch
draw poplar-twig poplar-twig
draw silk-tree silk-tree
draw wang-tree wang-tree --seed 1
draw wang-fig8 wang-fig8 --seed 1
draw bamboo bamboo
draw wang-bamboo wang-bamboo --seed 1
draw tree-models tree-models --seed 1 --view front
draw textbook-plants textbook-plants --seed 1 --view front
draw grass grass --seed 1 $studio
draw rain-twig rain-leaves --frame 1 --set frames.end=2
draw catkin catkin --background "#2a2f36" $(eye 0.012,0.026,0.062 0,0.0125,0)
draw anabaena anabaena --seed 1 $(eye 0.12,0.36,1.2 0.12,0.34,0)
draw koch koch --view front
draw dragon dragon --view front
draw hilbert hilbert
draw gosper gosper --view front
draw sierpinski sierpinski --view front
draw penrose penrose --view front

# All pictures on one sheet, also by the name "sheet".
if [ "$wanted" = "  " ] || [[ "$wanted" == *" sheet "* ]]; then
    "${PYTHON:-python3}" - "${names[@]}" <<'PY'
import sys
from PIL import Image, ImageDraw

names, columns, one, line = sys.argv[1:], 8, 150, 16
rows = -(-len(names) // columns)
sheet = Image.new("RGB", (columns * (one + 4) - 4, rows * (one + line + 4) - 4), "#f6f5f1")
write = ImageDraw.Draw(sheet)
for k, name in enumerate(names):
    at = (k % columns * (one + 4), k // columns * (one + line + 4))
    picture = Image.open(f"docs/gallery/grammar-{name}.jpg").resize((one, one), Image.LANCZOS)
    sheet.paste(picture, at)
    write.text((at[0] + 4, at[1] + one + 2), name, fill="#333")
sheet.save("docs/gallery/grammars.jpg", quality=86, optimize=True)
PY
fi
