# Configures and builds a preset with one calm progress line. Sourced after packages.sh, in the top folder.

# build_preset PRESET [TARGET...]: the whole log is build/PRESET.log; its end is shown when something fails.
build_preset() {
    local preset=$1 log=build/$1.log jobs started=$SECONDS
    shift
    mkdir -p build
    jobs=$(build_jobs)
    if ! cmake --preset "$preset" >"$log" 2>&1 </dev/null; then
        tail -n 20 "$log" >&2
        fail "cmake --preset $preset failed; the whole of it is in $log"
    fi
    if ! NINJA_STATUS='[%f/%t] ' cmake --build --preset "$preset" --parallel "$jobs" ${1:+--target "$@"} \
            2>&1 </dev/null | tee -a "$log" | progress_line "Building $preset"; then
        # The first failure says most; what follows it is often its echo.
        { grep -m1 -A 30 '^FAILED:' "$log" || tail -n 30 "$log"; } >&2
        fail "the build failed; the whole of it is in $log"
    fi
    say "Built $preset in $((SECONDS - started)) s"
}

# A compiler process takes up to 1.2 GB here: fewer of them on a machine with many cores and little memory.
build_jobs() {
    local cores memory
    cores=$(nproc)
    memory=$(awk '/^MemAvailable:/ {print int($2 / 1200000)}' /proc/meminfo)
    echo $((memory < 1 ? 1 : memory < cores ? memory : cores))
}

# progress_line TITLE: the steps of ninja on standard input as one line that rewrites itself; nothing off a terminal.
progress_line() {
    local line
    while IFS= read -r line; do
        [[ -t 1 && $line =~ ^\[([0-9]+)/([0-9]+)\] ]] || continue
        printf '\r%s  %d of %d ' "$1" "${BASH_REMATCH[1]}" "${BASH_REMATCH[2]}"
    done
    [[ ! -t 1 ]] || printf '\r\033[K'
}
