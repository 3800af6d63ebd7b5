#!/usr/bin/env bash
# Does a result within a bound hold, seed by seed? One run a seed of each model, by the four methods in turn, which takes
# hours; then the largest distances of each model and method.
#   bench/bounds.sh FIRST LAST [--promise] MODEL:BOUND...      bench/bounds.sh 20000 20099 DIR/igea.ply:0.006
# With --promise without the independent measure, which takes as long as the search. stipple-bound-check in PATH.
set -euo pipefail

methods=(hierarchical iterative multiphase particles)
first=$1 last=$2
shift 2
only=()
if [[ ${1-} == --promise ]]; then
    only=("$1")
    shift
fi
for ((seed = first; seed <= last; seed++)); do
    turn=$seed
    for model; do
        stipple-bound-check "${model%:*}" "${only[@]}" --threads 1 --bound "${model##*:}" \
            --methods "${methods[turn++ % 4]}" --first "$seed"
    done
done | awk -F ' *[|] *' '
    function larger(key, column) { if ($column + 0 > largest[key, column] + 0) largest[key, column] = $column }
    $14 ~ /^[0-9]/ {
        key = $2 " | " $3 " | " $4
        if (!(key in seeds)) order[++rows] = key
        split($7, kept, /\.\./)
        if (!(key in seeds) || kept[1] < fewest[key]) fewest[key] = kept[1]
        if (kept[2] > most[key]) most[key] = kept[2]
        ++seeds[key]
        whole[key] += $8
        broken[key] += $13
        seconds[key] += $14
        for (column = 9; column <= 12; ++column) larger(key, column)
    }
    END {
        print "| model | method | bound | seeds | kept | whole | random | points | independent | certain | broken | s |"
        print "|---|---|---|---|---|---|---|---|---|---|---|---|"
        for (row = 1; row <= rows; ++row) {
            key = order[row]
            printf "| %s | %d | %d..%d | %d |", key, seeds[key], fewest[key], most[key], whole[key]
            for (column = 9; column <= 12; ++column) printf " %s |", largest[key, column]
            printf " %d | %.0f |\n", broken[key], seconds[key] / seeds[key]
        }
    }'
