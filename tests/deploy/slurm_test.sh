#!/usr/bin/env bash
# Runs deploy/slurm/isoscope.sbatch for real: a controller of Slurm and two nodes on this machine, in a
# temporary folder with a key and free ports of its own. Checks that the picture through the job has the
# bytes of the local one, with shards on the shared and on the nodes' own disk, that a missing dataset is made, that a
# job ends cleanly with its command, on scancel and at the end of its time, and that a lost agent ends it.
#
#   tests/deploy/slurm_test.sh PROGRAMS [VOLUME [ISOVALUE]]
#
# Exits with 77, and says why, where Slurm cannot run. Needs: slurm-wlm munge (Debian).
# shellcheck disable=SC2016  # `check ... eval` expands later
set -euo pipefail

[ "$#" -ge 1 ] || {
  echo "Usage: slurm_test.sh PROGRAMS [VOLUME [ISOVALUE]]" >&2
  exit 2
}
bin="$(realpath "$1")"
volume="${2:-/usr/share/mricron/templates/ch2.nii.gz}"
isovalue="${3:-60}"
root="$(realpath "$(dirname "${BASH_SOURCE[0]}")/../..")"
job_script="$root/deploy/slurm/isoscope.sbatch"
scripts="$root/scripts"

skip() {
  local code=0
  python3 "$root/tests/support/skips.py" slurm "$*" || code=$?
  exit "$code"
}
export PATH="$PATH:/usr/sbin:/sbin"
for program in munged slurmctld slurmd sbatch srun squeue scancel scontrol; do
  command -v "$program" >/dev/null || skip "no $program (Debian: slurm-wlm slurm-client munge)"
done
[ -r "$volume" ] || skip "no volume '$volume' (Debian: mricron-data)"

work="$(mktemp -d)"
chmod 755 "$work"
pids=()
finish() {
  local code=$?
  trap - EXIT
  if [ -e "$work/slurm.conf" ]; then
    scancel --me >/dev/null 2>&1 || true
    local tries
    for ((tries = 0; tries < 100; tries++)); do
      [ -n "$(squeue --noheader 2>/dev/null)" ] || break
      sleep 0.2
    done
  fi
  local pid
  # In the order of their start: the nodes, the controller, munge.
  for pid in "${pids[@]}"; do
    kill "$pid" 2>/dev/null || true
  done
  wait 2>/dev/null || true
  if [ "$code" -ne 0 ] && [ "$code" -ne 77 ]; then
    tail -n 5 "$work"/slurmctld.log "$work"/n?.log "$ISOSCOPE_RUN"/*.log 2>/dev/null || true
  fi
  rm -rf "$work"
  exit "$code"
}
trap finish EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

failed=0
checks=0
check() {
  local what="$1"
  shift
  checks=$((checks + 1))
  if "$@"; then
    echo "pass  $what"
  else
    failed=$((failed + 1))
    echo "FAIL  $what"
  fi
}

# eventually SECONDS COMMAND...
eventually() {
  local deadline=$((SECONDS + $1))
  shift
  until "$@"; do
    [ "$SECONDS" -lt "$deadline" ] || return 1
    sleep 0.2
  done
}

# The munge daemon wants a private folder for its key and an open one for its socket.
start_slurm() {
  local host ports user
  host="$(hostname -s)"
  user="$(id -un)"
  read -ra ports <<<"$(python3 "$root/tests/support/free_ports.py" 3)"
  mkdir -p "$work/munge" "$work/socket" "$work/state" "$work/n1" "$work/n2"
  chmod 700 "$work/munge"
  chmod 755 "$work/socket"
  head -c 1024 /dev/urandom >"$work/munge/key"
  chmod 400 "$work/munge/key"
  cat >"$work/slurm.conf" <<CONF
ClusterName=isoscope_test
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=${ports[0]}
SlurmUser=$user
SlurmdUser=$user
AuthType=auth/munge
AuthInfo=socket=$work/socket/munge
CredType=cred/munge
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/%n
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/%n.pid
SlurmctldLogFile=$work/slurmctld.log
SlurmdLogFile=$work/%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/linear
ReturnToService=2
MailProg=/bin/true
MpiDefault=none
KillWait=30
OverTimeLimit=0
SlurmdParameters=config_overrides
NodeName=n1 NodeHostname=$host NodeAddr=127.0.0.1 Port=${ports[1]} CPUs=$(nproc)
NodeName=n2 NodeHostname=$host NodeAddr=127.0.0.1 Port=${ports[2]} CPUs=$(nproc)
PartitionName=test Nodes=n1,n2 Default=YES State=UP MaxTime=INFINITE
CONF
  export SLURM_CONF="$work/slurm.conf"
  munged --foreground --force --key-file="$work/munge/key" --socket="$work/socket/munge" \
    --pid-file="$work/munge/pid" --seed-file="$work/munge/seed" --log-file="$work/munged.log" \
    >"$work/munged.out.log" 2>&1 &
  local munge_pid=$!
  pids=("$munge_pid")
  eventually 10 test -S "$work/socket/munge" || return
  slurmctld -D -i -f "$SLURM_CONF" >"$work/slurmctld.out.log" 2>&1 &
  pids=("$!" "${pids[@]}")
  local node
  for node in n1 n2; do
    slurmd -D -N "$node" -f "$SLURM_CONF" >"$work/$node.out.log" 2>&1 &
    pids=("$!" "${pids[@]}")
  done
  eventually 60 nodes_are_idle
}

nodes_are_idle() { [ "$(sinfo --noheader --Node --format=%t 2>/dev/null | sort -u)" = idle ]; }

start_slurm || {
  # shellcheck disable=SC2012
  skip "Slurm does not start here: $(cat "$work"/*.log 2>/dev/null | grep -iE 'error|fatal' | tail -n 2 | tr '\n' ' ')"
}
echo "== Slurm: $(sinfo --version), nodes $(sinfo --noheader --Node --format=%N | tr '\n' ' ')"

isoscope() { "$bin/isoscope" "$@"; }
isoscope partition "$volume" --output "$work/four" --shards 4 >/dev/null
isoscope render "$work/four" --renderer cpu --isovalue "$isovalue" --output "$work/local.png" >/dev/null
export ISOSCOPE_BIN="$bin" ISOSCOPE_RENDERER=cpu

# submit NAME SBATCH-OPTIONS... -- ARGUMENTS...: sets `job`.
submit() {
  local options=()
  name_of_job="$1"
  shift
  while [ "$1" != -- ]; do
    options+=("$1")
    shift
  done
  shift
  export ISOSCOPE_RUN="$work/run-$name_of_job"
  job="$(sbatch --parsable --output="$work/$name_of_job.log" --chdir="$work" "${options[@]}" "$job_script" "$@")"
}
state_of() { scontrol --oneliner show job "$1" | sed -n 's/.*JobState=\([A-Z]*\).*/\1/p'; }
# serves SECONDS: until the job serves; shows its log if it does not.
serves() {
  eventually "$1" eval '[ -e "$ISOSCOPE_RUN/address" ] || has_ended "$job"'
  [ -e "$ISOSCOPE_RUN/address" ] || {
    scontrol --oneliner show job "$job"
    cat "$work/$name_of_job.log"
    return 1
  }
}
has_ended() { [[ "$(state_of "$1")" =~ ^(COMPLETED|CANCELLED|FAILED|TIMEOUT|NODE_FAIL)$ ]]; }
# refuses COMMAND...: it fails, and writes no picture.
refuses() {
  rm -f "$work/c.png"
  ! "$@" >"$work/refused.log" 2>&1 && [ ! -e "$work/c.png" ]
}
is_state() { [ "$(state_of "$1")" = "$2" ] || { echo "      state $(state_of "$1")"; return 1; }; }
none_left() { [ -z "$(pids_of)" ]; }
# pids_of [PROGRAM]: the servers of this job, and no others: their logs lie in its folder.
pids_of() {
  local process
  for process in /proc/[0-9]*; do
    if [[ "$(readlink "$process/exe" 2>/dev/null)" == "$bin"/isoscope-${1:-*} ]] &&
      tr '\0' '\n' <"$process/environ" 2>/dev/null | grep -qx "ISOSCOPE_RUN=$ISOSCOPE_RUN"; then
      echo "${process#/proc/}"
    fi
  done
}
all_logs_say() { [ "$(grep -l "$1" "$ISOSCOPE_RUN"/agent-?.log "$ISOSCOPE_RUN/coordinator.log" | wc -l)" -eq 3 ]; }
render_from_job() {
  isoscope render --server "$(cat "$ISOSCOPE_RUN/address")" --isovalue "$isovalue" --output "$work/$1" >/dev/null
}

echo "== a job that serves, until scancel"
submit serve -- "$work/four"
check "the job says its address" serves 120
check "its picture has the bytes of the local one" eval 'render_from_job a.png && cmp "$work/a.png" "$work/local.png"'
check "two agents have two shards each" eval \
  '[ "$(grep -l "[0-3],[0-3] of 4" "$ISOSCOPE_RUN"/agent-?.log | wc -l)" -eq 2 ]'
scancel "$job"
check "it ends" eventually 60 has_ended "$job"
check "nothing of it is left" eventually 60 none_left
check "agents and coordinator ended by themselves" all_logs_say _stopped

echo "== a job with a command; shards on the nodes' own disk; a dataset that is made first"
export ISOSCOPE_INPUT="$volume" ISOSCOPE_LOCAL="$work/local-disk"
mkdir "$ISOSCOPE_LOCAL"
submit command -- "$work/made" isoscope render --isovalue "$isovalue" --output "$work/b.png"
check "it ends" eventually 180 has_ended "$job"
check "it is COMPLETED" is_state "$job" COMPLETED
check "the dataset has a shard for each node" eval '[ "$(ls -d "$work"/made/shard-* | wc -l)" -eq 2 ]'
check "the picture has the bytes of the local one" cmp "$work/b.png" "$work/local.png"
check "both nodes copied their shard" eval '[ "$(grep -c "copied 1 shards to $ISOSCOPE_LOCAL" "$work/command.log")" -eq 2 ]'
check "the copies are gone" eval '[ -z "$(ls "$ISOSCOPE_LOCAL")" ]'
check "nothing of it is left" eventually 60 none_left
check "agents and coordinator ended by themselves" all_logs_say _stopped
submit failing -- "$work/made" false
check "a command that fails ends the job" eventually 120 has_ended "$job"
check "as FAILED" is_state "$job" FAILED
unset ISOSCOPE_LOCAL

echo "== frames in work"
# Some seconds of work for two agents with a thread each.
isoscope generate random --dims 256,256,256 --type uint8 --output "$work/field.nrrd" >/dev/null
isoscope partition "$work/field.nrrd" --output "$work/field" --shards 2 >/dev/null
# Several bands, since 4 samples a pixel have 16 layers, within the 20 s that frames get to end.
heavy=(--culling none --width 1024 --height 1024 --max-layers 16)
for value in $(seq 70 30 190); do
  heavy+=(--surface "$value:0.9,0.6,0.3:0.3")
done
isoscope render "$work/field" --renderer cpu "${heavy[@]}" --output "$work/heavy.png" >/dev/null
# Whether the agents are drawing a frame, or the command PID that asked for it is gone.
draws_or_has_ended() {
  isoscope top --server "$(cat "$ISOSCOPE_RUN/address")" --once 2>/dev/null | grep -q ' 3 visible ' ||
    ! kill -0 "$1" 2>/dev/null
}
for how in "scancel" "scancel --signal=USR1 --batch"; do
  ISOSCOPE_THREADS=1 ISOSCOPE_MEMORY_LIMIT=3GiB submit drain -- "$work/field"
  check "the job serves" serves 60
  isoscope render --server "$(cat "$ISOSCOPE_RUN/address")" "${heavy[@]}" --output "$work/drained.png" \
    >/dev/null 2>"$work/drained.log" &
  render=$!
  eventually 60 draws_or_has_ended "$render" || true
  kill -0 "$render" 2>/dev/null || echo "      this machine is too fast: the frame has ended before $how"
  $how "$job"
  if wait "$render"; then
    check "a frame in work is finished after $how" cmp "$work/drained.png" "$work/heavy.png"
  else
    check "a frame in work is finished after $how: $(cat "$work/drained.log")" false
  fi
  rm -f "$work/drained.png"
  check "the job ends" eventually 60 has_ended "$job"
  check "agents and coordinator ended by themselves" all_logs_say _stopped
  rm -r "$ISOSCOPE_RUN"
done

echo "== the end of its time"
submit time --signal=B:USR1@50 --time=00:01:00 -- "$work/four"
check "the job serves" serves 60
check "it ends" eventually 120 has_ended "$job"
check "it is COMPLETED" is_state "$job" COMPLETED
check "it says why" grep -q "its time is up" "$work/time.log"
check "agents and coordinator ended by themselves" all_logs_say _stopped

if [ -e "$scripts/make_certificates.sh" ] && [[ "$("$bin/isoscope-agent" --help)" == *--tls-cert* ]]; then
  echo "== TLS"
  bash "$scripts/make_certificates.sh" "$work/certificates" --agent agents --coordinator "$(hostname)" >/dev/null
  ISOSCOPE_CERTIFICATES="$work/certificates" submit tls -- "$work/four"
  check "the job serves" serves 120
  server=(--server "$(cat "$ISOSCOPE_RUN/address")" --isovalue "$isovalue" --output "$work/c.png")
  check "a client with the token gets the picture" isoscope render "${server[@]}" --tls-ca "$work/certificates/ca.pem" \
    --token-file "$work/certificates/token"
  check "it has the bytes of the local one" cmp "$work/c.png" "$work/local.png"
  check "a client without a token gets none" refuses isoscope render "${server[@]}" \
    --tls-ca "$work/certificates/ca.pem"
  check "a client without TLS gets none" refuses isoscope render "${server[@]}" --insecure
  scancel "$job"
  check "it ends" eventually 60 has_ended "$job"
fi

echo "== errors"
submit lost -- "$work/four"
check "the job serves" serves 60
mapfile -t agents < <(pids_of agent)
kill -KILL "${agents[0]}"
check "a lost agent ends the job" eventually 120 has_ended "$job"
check "as FAILED" is_state "$job" FAILED
check "nothing of it is left" eventually 60 none_left
unset ISOSCOPE_INPUT
submit nothing -- "$work/nowhere"
check "no dataset and no volume: it ends" eventually 60 has_ended "$job"
check "as FAILED" is_state "$job" FAILED
check "and says what is missing" grep -q "ISOSCOPE_INPUT" "$work/nothing.log"

if [ "$failed" -gt 0 ]; then
  echo "slurm_test.sh: FAILED: $failed of $checks checks"
  exit 1
fi
echo "slurm_test.sh: passed: $checks checks in $SECONDS s"
