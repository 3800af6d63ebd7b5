# What every script here says and asks. Sourced.

say() { printf '%s\n' "$*"; }
fail() { printf '%s\n' "$*" >&2; exit 1; }

# free_port FROM: the first port from there on that nothing on this machine listens at.
free_port() {
    local port
    for ((port = $1; port < $1 + 100; ++port)); do
        (: </dev/tcp/127.0.0.1/"$port") 2>/dev/null || { echo "$port"; return; }
    done
    fail "no free port in $1..$((port - 1))"
}
