#!/usr/bin/env bash
# Makes the gallery's pictures that are osier's own again: docs/gallery/make.sh [NAME...]. A few minutes for all of them.
# The others: sapling.png and sapling-renders.png as docs/tutorial.md says, showcase, catkins-ground.png, preview-cycles by Cycles (render.py), stand and stand-pov as docs/growth.md says, wet-leaf, rain-fig1, rain-fig14, rain-pendant by rain.sh, rain-cycles by render.py as docs/rain.md says,
# wind-slices by slices.py from a bake, plots of flows by flows.py, other plots by the benches that docs name beside them; catkins-fig12, catkins-fig13, catkins-ground.gif and catkins-wall.gif by catkins.sh; those of hoetzlein.md by shapes.sh.
set -euo pipefail
cd "$(dirname "$0")/../.."
cargo build --release --quiet
wanted=" $* "

# NAME.ENDING SOURCE FLAGS...
make() {
    local file=$1
    shift
    if [ "$wanted" = "  " ] || [[ "$wanted" == *" ${file%.*} "* ]]; then
        target/release/osier preview "$@" -o "docs/gallery/$file" --force
    fi
}
eye() { printf -- '--set camera.eye=[%s] --set camera.target=[%s]' "$1" "$2"; }

one="--size 400x400 --quality fine"
make oak.png oak $one
make birch.png birch $one
make poplar-twig.png poplar-twig $one
make silk-tree.png silk-tree $one
make bamboo.png bamboo $one
make bamboo-culms.png bamboo $one --sun 32,-30 $(eye 1.2,1.1,1.6 0,1.5,0)
make oak-leaves.png oak $one --sun 32,-10 $(eye 3.4,2.1,2.6 1.6,2.3,1.2)
make birch-bark.png birch $one --sun 32,0 $(eye 0.75,1.3,0.55 0,1.35,0)
make poplar-leaves.png poplar-twig $one --sun 45,30 $(eye 0.35,0.9,0.45 0,0.95,0)
make oak-seeds.png oak --seeds 0-5 --size 300x330
make silk-tree-seeds.png silk-tree --seeds 0-15 --columns 4 --size 230x230
make landscape.png landscape --size 1200x675
make catkins-street.png catkins-street --frame 200 --size 1200x675
make storm-oak.png storm-oak --frame 24 --size 1200x675
make fig9.png fig9 --size 1200x675
make meadow.gif meadow --frames 1-96:4 --size 400x225
make struck-twig.gif struck-twig --frames 1-72:2 --size 320x320
