#!/usr/bin/env bash
# The Debian package under a systemd of its own: installed in a small Debian that systemd-nspawn boots.
# As root, with debootstrap and systemd-container; two minutes.
#
#   cargo deb --strip -o tog.deb && tests/package.sh tog.deb
set -euo pipefail
deb=$(realpath "${1:?which package: tests/package.sh tog.deb}")
deploy=$(realpath "$(dirname "$0")/../deploy")
scratch=$(mktemp -d)
root=$scratch/root
nspawn=
end() {
    [ -z "$nspawn" ] || { kill "$nspawn"; wait "$nspawn" || true; } 2>/dev/null
    rm -rf "$scratch"
}
trap end EXIT

debootstrap --variant=minbase --include=systemd,systemd-sysv,dbus,procps bookworm "$root" \
    http://deb.debian.org/debian >"$scratch/log" 2>&1 || { tail "$scratch/log"; exit 1; }
cp "$deb" "$root/root/tog.deb"
# A machine with the older control groups shows only the newer ones to whom it boots.
boot='[ -e /sys/fs/cgroup/cgroup.controllers ] ||
    { umount -R /sys/fs/cgroup && mount -t cgroup2 none /sys/fs/cgroup; }
    exec systemd-nspawn --quiet --directory "$1" --boot --register=no --keep-unit --private-network'
unshare --mount bash -c "$boot" boot "$root" </dev/null >"$scratch/boot" 2>&1 &
nspawn=$!
inside() { nsenter --target "$(pgrep --parent "$nspawn" | head -1)" --all -- "$@"; }
told() { # told WHAT COMMAND..: what is shown
    local what=$1
    shift
    if inside "$@" >"$scratch/out" 2>&1; then
        echo "ok: $what"
    else
        echo "not ok: $what" && cat "$scratch/out"
        inside journalctl --no-pager --output cat | tail -40
        exit 1
    fi
}
as_tog() { echo "runuser -u tog -- env TOG_RUN_DIR=/run/tog TOG_HOST=edge tog $*"; }
main_pid() { inside systemctl show --property MainPID --value tog@two-hosts; }
is_new() { [ "$(inside systemctl is-active tog@two-hosts)" = active ] && [ "$(main_pid)" != "$1" ]; }
comes_back() { # comes_back WHAT PID
    for _ in $(seq 400); do
        if is_new "$2"; then
            echo "ok: $1"
            return 0
        fi
        sleep 0.2
    done
    echo "not ok: $1" && inside systemctl status --no-pager tog@two-hosts
    exit 1
}

for _ in $(seq 120); do
    inside systemctl is-system-running >"$scratch/out" 2>&1 && break
    sleep 0.5
done
told "it boots" systemctl is-system-running
told "the package is installed" dpkg --install /root/tog.deb
cp "$deploy/two-hosts.toml" "$root/etc/tog/"
sed -i 's/"plain-tcp"/"tls"/' "$root/etc/tog/two-hosts.toml"
echo TOG_HOST=edge >>"$root/etc/default/tog"
told "certificates are made" sh -c 'cd /root; tog certs init /etc/tog/two-hosts.toml --ca ca &&
    tog certs issue /etc/tog/two-hosts.toml --ca ca --out tls && cp tls/edge/* /etc/tog/tls && cp tls/desk/desk.* /etc/tog/tls &&
    chown -R tog:tog /etc/tog/tls && chmod 0600 /etc/tog/tls/*'
told "its unit starts, and says that it works" systemctl enable --now tog.target tog@two-hosts
told "the other host is heard, through TLS" sh -c "
    $(as_tog run /etc/tog/two-hosts.toml --host desk | sed 's:/run/tog:/tmp/desk:') >/tmp/desk.log 2>&1 &
    for n in \$(seq 50); do
        $(as_tog status /etc/tog/two-hosts.toml --site) | grep 'desk  *heard' && exit 0
        sleep 0.5
    done; exit 1"
told "data flows, says the doctor" sh -c "
    $(as_tog doctor /etc/tog/two-hosts.toml) | grep 'ok *laser north.*scans out a second'"
told "metrics are written" sh -c 'systemctl start tog-metrics@two-hosts &&
    grep tog_ /var/lib/tog-metrics/two-hosts.prom'
killed=$(main_pid)
inside kill -KILL "$killed"
comes_back "it comes back after a kill -9 of its supervisor" "$killed"
stopped=$(main_pid)
inside kill -STOP "$stopped"
comes_back "it comes back after its supervisor hung: the watchdog" "$stopped"
told "an upgrade leaves it running" sh -c 'dpkg --install /root/tog.deb &&
    systemctl is-active tog@two-hosts'
before=$(main_pid)
inside systemctl restart tog.target
comes_back "a restart of the target is one of the site" "$before"
told "it stops" systemctl stop tog@two-hosts
told "and leaves nothing but its state" sh -c 'pkill -f "host [d]esk"; sleep 1; [ -z "$(ls /dev/shm /run/tog | grep -v :)" ] &&
    ls /var/lib/tog/two-hosts/edge/journal.sqlite3'
told "the package is removed, and the state stays" sh -c 'dpkg --purge tog &&
    ls /var/lib/tog/two-hosts/edge/journal.sqlite3'
