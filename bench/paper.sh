#!/usr/bin/env bash
# The paper's experiments on clouds that can be had (README.md, "The paper"): figures and pictures into a folder.
#
#     bench/paper.sh IGEA DRAGON OUT          the igea and the dragon (435,545 points) as PLY; stipple is found in PATH
set -euo pipefail
(($# == 3)) || { sed -n '2,4s/^# \{0,1\}//p' "$0"; exit 2; }
igea=$1 dragon=$2 out=$3
mkdir -p "$out"

# Figure 10: two million points to 5,000 by each method. The David cannot be had: a synthetic scan as large stands for it.
figure_10() {
    local name=$1 cloud=$2 method
    for method in incremental hierarchical iterative particles multiphase; do
        stipple simplify "$cloud" "$out/$name-$method.ply" --method $method --points 5000 --no-error --quiet
    done
    echo "Figure 10, $name to 5,000 points"
    stipple evaluate "$cloud" "$out/$name-"{incremental,hierarchical,iterative,particles,multiphase}.ply \
        --map "$out/figure-10-$name.png" --json "$out/figure-10-$name.json" 2>&1
}

# Figure 12: simplified by the centroids of incremental clustering, then upsampled by particles: what it smooths away.
figure_12() {
    echo "Figure 12, dragon to 9,863 points and back to 435,545"
    stipple simplify "$dragon" "$out/dragon-9863.ply" --method incremental --representative centroid --points 9863 --no-error
    stipple upsample "$out/dragon-9863.ply" "$out/dragon-again.ply" --points 435545 --no-error
    stipple evaluate "$dragon" "$out/dragon-9863.ply" "$out/dragon-again.ply" \
        --map "$out/figure-12.png" --json "$out/figure-12.json" 2>&1
}

[[ -e $out/ammonite.ply ]] || stipple synthesize "$out/ammonite.ply" --points 2000606 --quiet
figure_10 ammonite "$out/ammonite.ply"
figure_10 igea "$igea"
figure_12
