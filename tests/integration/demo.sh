#!/usr/bin/env bash
# The main job on a synthetic room: one server, two RGB-D clients at the same time, each on its own
# way through the room. Prints how exact the clients' corrected trajectories are and what it cost.
# Everything that it makes goes to build/demo/.
#   tests/integration/demo.sh BUILD_DIR [--frames N]
# Exit: 0 when both clients delivered everything and stayed within the bound on the error, else 1.
set -euo pipefail

readonly SCENE=desk
readonly CLIENTS=(alice bob)     # client i walks path i
readonly MAX_ATE=0.05            # metres; a sanity bound, the tests are stricter

die() { echo "demo: $*" >&2; exit 1; }

[[ $# -ge 1 ]] || die "usage: demo.sh BUILD_DIR [--frames N]"
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
[[ -d $1/bin ]] || die "$1/bin is missing; ./dev build makes build/release"
bin=$(cd "$1/bin" && pwd)
frames=300
case "${2:-}" in
  "") ;;
  --frames) frames=${3:-} ;;
  *) die "unknown option $2; there is --frames N" ;;
esac
[[ $frames =~ ^[1-9][0-9]*$ ]] || die "--frames takes a number of frames, such as 300"
for program in cairn cairn-server cairn-client; do
  [[ -x $bin/$program ]] || die "$bin/$program is missing; ./dev build makes it"
done

readonly out=$root/build/demo
rm -rf "$out"
mkdir -p "$out"
# Loopback only, and a tag of its own: nothing else on this machine is seen or heard.
export CYCLONEDDS_URI="file://$root/config/cyclonedds_loopback.xml"
export CAIRN_DDS_TAG="demo-$$"

# Ends what this script has started and what still runs; nothing else.
started=()
end_started() {
  local pid
  trap - EXIT INT TERM
  for pid in "${started[@]}"; do kill -TERM "$pid" 2>/dev/null || true; done
  for pid in "${started[@]}"; do wait "$pid" 2>/dev/null || true; done
}
trap end_started EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

failed_with_log() {
  local what=$1 log=$2
  tail -n 20 "$log" >&2
  die "$what; its log: $log"
}

start_server() {
  "$bin/cairn-server" --config "$root/config/server.yaml" --map "$out/map.db" 2>"$out/server.log" &
  server=$!
  started+=("$server")
  local tries
  for ((tries = 0; tries < 100; ++tries)); do
    grep -q 'ready: ' "$out/server.log" && return
    kill -0 "$server" 2>/dev/null || break
    sleep 0.1
  done
  failed_with_log "the server did not start" "$out/server.log"
}

stop_server() {
  local status=0
  kill -TERM "$server"
  wait "$server" || status=$?
  [[ $status -eq 0 ]] || failed_with_log "the server ended with $status" "$out/server.log"
}

start_client() {
  local name=$1 path=$2
  "$bin/cairn-client" --config "$root/config/client_synth.yaml" --name "$name" \
    --input "synth:$SCENE?path=$path&frames=$frames" \
    --trajectory "$out/$name.tum" --outbox "$out/$name.outbox" \
    >"$out/$name.report" 2>"$out/$name.log" &
  clients+=($!)
  started+=($!)
}

# The number behind a name in a client's report.
reported() { awk -v name="$2" '$1 == name { print $2 }' "$out/$1.report"; }

rmse_in() {
  awk '/"ate_m"/ { here = 1 } here && /"rmse"/ { gsub(/[^0-9.e+-]/, "", $2); print $2; exit }' "$1"
}

# The RMSE of the absolute trajectory error, metres.
ate() {
  "$bin/cairn" synth --scene "$SCENE" --path "$2" --frames "$frames" --poses-only \
    --out "$out/$1.truth.tum" >/dev/null
  "$bin/cairn" eval "$out/$1.truth.tum" "$out/$1.tum" --json >"$out/$1.eval.json"
  rmse_in "$out/$1.eval.json"
}

days_later() {
  awk -v shift=$(($1 * 86400)) '/^#/ { next }
    { printf "%.6f", $1 + shift; for (f = 2; f <= 8; ++f) printf " %s", $f; print "" }'
}

# Of all clients together with one alignment: small only when they are in one map. Each gets stamps
# of its own, a day apart.
joint_ate() {
  local i
  for i in "${!CLIENTS[@]}"; do
    days_later "$i" <"$out/${CLIENTS[i]}.truth.tum" >>"$out/joint.truth.tum"
    days_later "$i" <"$out/${CLIENTS[i]}.tum" >>"$out/joint.tum"
  done
  "$bin/cairn" eval "$out/joint.truth.tum" "$out/joint.tum" --json >"$out/joint.eval.json"
  rmse_in "$out/joint.eval.json"
}

print_row() { printf '%-8s %7s %8s %8s %10s %9s %12s %14s %8s %10s\n' "$@"; }

print_table() {
  local i name error
  print_row client frames dropped tracked keyframes 'ATE m' 'tracking ms' 'correction ms' \
    'up kB/s' 'down kB/s'
  for i in "${!CLIENTS[@]}"; do
    name=${CLIENTS[i]}
    error=$(ate "$name" "$i")
    [[ -n $error ]] || failed_with_log "$name's trajectory can't be judged" "$out/$name.log"
    awk -v e="$error" -v max="$MAX_ATE" 'BEGIN { exit !(e + 0 <= max) }' || too_far+=("$name")
    print_row "$name" "$(reported "$name" frames)" "$(reported "$name" dropped)" \
      "$(reported "$name" tracked)" "$(reported "$name" keyframes)" "$(printf '%.4f' "$error")" \
      "$(reported "$name" tracking_ms_median)" "$(reported "$name" correction_ms_median)" \
      "$(reported "$name" up_kB_per_s)" "$(reported "$name" down_kB_per_s)"
  done
}

start_server
clients=()
echo "demo: a server and ${#CLIENTS[@]} RGB-D clients in scene '$SCENE', $frames frames each at 30 Hz" >&2
for i in "${!CLIENTS[@]}"; do start_client "${CLIENTS[i]}" "$i"; done
for i in "${!CLIENTS[@]}"; do
  status=0
  wait "${clients[i]}" || status=$?
  name=${CLIENTS[i]}
  [[ $status -eq 0 ]] || failed_with_log "client $name ended with $status" "$out/$name.log"
done
stop_server
started=()

too_far=()
print_table
echo "(ATE: RMSE of the corrected trajectory after alignment; tracking, correction: medians;"
echo " dropped: frames that came while tracking was busy, as with a camera;"
echo " up, down: keyframes and map updates, kilobytes a second of the recording)"
echo
echo "What the server counted:"
sed -n 's/.*\(client [^ ]* left after .*\)/  \1/p' "$out/server.log"
echo
joint=$(joint_ate)
printf 'One map, %s: ATE of both clients together, one alignment: %.4f m\n' "$out/map.db" "$joint"
awk -v e="$joint" -v max="$MAX_ATE" 'BEGIN { exit !(e + 0 <= max) }' || too_far+=("both together")
"$bin/cairn" map info "$out/map.db" | sed 's/^/  /'
[[ ${#too_far[@]} -eq 0 ]] || die "ATE above $MAX_ATE m: ${too_far[*]}"
