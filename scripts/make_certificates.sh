#!/usr/bin/env bash
# Makes a private authority, a certificate for each party, and a token for clients:
#
#   scripts/make_certificates.sh OUT [--agent NAME...] [--coordinator NAME...] [--gateway NAME...] [--days N]
#
#   OUT/ca.pem  ca.key                      the authority; keep ca.key where none of the programs runs
#   OUT/agent.pem  agent.key                for isoscope-agent --tls-cert, --tls-key; likewise coordinator.*, gateway.*
#   OUT/client.pem  client.key              for people and programs that may see everything
#   OUT/token  tokens.json                  a token for clients, and its entry for isoscope-coordinator --tokens
#
# NAME: a DNS name or an address by which others reach the party; any number of each. All have localhost,
# 127.0.0.1 and ::1, too. With "dns:///isoscope-agents:50052" all agents share the name isoscope-agents.
#
# Run again, it keeps the authority and the token and renews the certificates (--days, default 365). It
# replaces each file at once, so that running programs can read them meanwhile. docs/security.md has the
# meaning of it all.
set -euo pipefail
umask 077

usage() {
  sed -n '2,/^set /p' "$0" | sed -e '/^set /d' -e 's/^# \{0,1\}//'
  exit "${1:-2}"
}

case "${1:-}" in
  -h | --help) usage 0 ;;
  "" | -*) usage >&2 ;;
esac
out="$1"
shift
days=365
declare -A names=([agent]="" [coordinator]="" [gateway]="" [client]="")
party=""
while [ $# -gt 0 ]; do
  case "$1" in
    --agent | --coordinator | --gateway) party="${1#--}" ;;
    --days)
      [ $# -ge 2 ] || usage >&2
      days="$2"
      shift
      ;;
    -*) usage >&2 ;;
    *)
      if [ -z "$party" ] || ! [[ "$1" =~ ^[A-Za-z0-9.:*_-]+$ ]]; then
        echo "make_certificates.sh: '$1' is no name of a party: give it after --agent, --coordinator or --gateway" >&2
        exit 2
      fi
      names[$party]+=" $1"
      ;;
  esac
  shift
done
if ! command -v openssl >/dev/null; then
  echo "make_certificates.sh: openssl is missing (Debian: apt-get install openssl)" >&2
  exit 1
fi

mkdir -p "$out"
work="$(mktemp -d "$out/.making-XXXXXX")"
trap 'rm -rf "$work"' EXIT
curve=(-newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes)

if [ ! -e "$out/ca.key" ]; then
  openssl req -x509 "${curve[@]}" -days 3650 -subj "/CN=Isoscope private authority" \
    -addext "keyUsage=critical,keyCertSign,cRLSign" -keyout "$work/ca.key" -out "$work/ca.pem" 2>/dev/null
  mv "$work/ca.key" "$work/ca.pem" "$out"
fi

# The names of a certificate: those given, those of every machine, and the role.
alternative_names() {
  local list="URI:isoscope:role:$1" name
  for name in ${names[$1]} localhost 127.0.0.1 ::1; do
    if [[ "$name" == *:* || "$name" =~ ^[0-9]+\.[0-9]+\.[0-9]+\.[0-9]+$ ]]; then
      list+=",IP:$name"
    else
      list+=",DNS:$name"
    fi
  done
  echo "$list"
}

for party in agent coordinator gateway client; do
  {
    echo "basicConstraints=critical,CA:false"
    echo "keyUsage=critical,digitalSignature"
    echo "extendedKeyUsage=serverAuth,clientAuth"
    echo "subjectAltName=$(alternative_names "$party")"
  } >"$work/extensions"
  openssl req "${curve[@]}" -subj "/CN=isoscope $party" -keyout "$work/$party.key" -out "$work/request" 2>/dev/null
  openssl x509 -req -in "$work/request" -CA "$out/ca.pem" -CAkey "$out/ca.key" -set_serial "0x$(openssl rand -hex 16)" \
    -days "$days" -extfile "$work/extensions" -out "$work/$party.pem" 2>/dev/null
  mv "$work/$party.key" "$work/$party.pem" "$out"
done

if [ ! -e "$out/token" ]; then
  openssl rand -hex 32 | tr -d '\n' >"$work/token"
  digest="$(openssl dgst -sha256 -r "$work/token" | cut -d ' ' -f 1)"
  printf '{"tokens": [\n  {"name": "everybody", "sha256": "%s", "datasets": ["*"]}\n]}\n' "$digest" >"$work/tokens.json"
  mv "$work/token" "$work/tokens.json" "$out"
fi
echo "$out: ca.pem, and .pem and .key of agent, coordinator, gateway and client, valid for $days days; token, tokens.json"
