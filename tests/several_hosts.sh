#!/usr/bin/env bash
# The figures of several hosts, as a table (Markdown). Builds and runs the tests that measure them; hosts
# are network namespaces where root and `ip` are there, else all on loopback, where no bytes are counted.
#
#   tests/several_hosts.sh            a few minutes: 4 cuts, 5 s of scans
#   tests/several_hosts.sh nightly    an hour: 50 cuts of 1, 10 and 60 s, 10 minutes of scans
set -euo pipefail
cd "$(dirname "$0")/.."
# The older version of the hosts that are upgraded: that of 2026-11-26, before scans went past the bridge's loop.
older=96a793f
if [ "${1:-}" = nightly ]; then
    export TOG_NIGHTLY=1
    if [ -z "${TOG_BIN_OLD:-}" ]; then
        [ -d target/older/source ] || git worktree add --detach target/older/source "$older" >&2
        CARGO_TARGET_DIR=target/older cargo build --manifest-path target/older/source/Cargo.toml >&2
        export TOG_BIN_OLD=$PWD/target/older/debug/tog
    fi
fi
log=$(mktemp)
trap 'rm -f "$log"' EXIT
# One at a time: each has the machine for itself.
for suite in lan cost overhead standby lost_state intruder clients three_hosts_say router upgrade; do
    echo "== $suite" | tee -a "$log" >&2
    cargo test --workspace --quiet --test system -- --nocapture --test-threads 1 "$suite" >>"$log" 2>&1 ||
        { cat "$log" >&2; exit 1; }
done
echo "| what | measured |"
echo "|---|---|"
row() { # row WHAT PATTERN: the lines of the log that match, without the name of the test before them
    local found
    found=$(grep -E "$2" "$log" | sed -E 's/^test [^ ]+ \.\.\. //' | paste -sd ';' | sed 's/;\([^ ]\)/; \1/g')
    [ -n "$found" ] && echo "| $1 | $found |"
    return 0
}
row "cut links" '^.*[0-9]+ cuts, '
row "a link that was full when it was cut" 'a link that was full: '
row "four lasers at 75 Hz" 'scans in [0-9.]+ s, '
row "bytes a second, measured and planned" '^[a-z]+: sends .* B/s of [0-9]+ planned'
row "what is followed, copied, told" 'lasers: sends [0-9]+ B/s'
row "bridges" '^  bridge: '
row "a scan to another host" 'a scan of 181 beams'
row "an area back at its standby" 'back after ms'
row "an area handed over" 'handed over after'
row "a desk behind two routers" 'a desk behind routers|through two routers'
row "hosts of two versions" 'upgraded (edge|desk)'
row "strangers who knock without end" 'strangers; scans again'
row "a host whose state was lost" 'began a new journal'
row "intruders" 'refused|unauthorised'
row "one host and three, the same classes" 'frames compared'
