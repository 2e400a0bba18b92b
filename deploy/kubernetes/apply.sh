#!/usr/bin/env bash
# Installs or updates an overlay in an order in which every shard keeps an agent: `kubectl apply` alone would
# replace pods of both replica groups at the same time.
#
#   deploy/kubernetes/apply.sh OVERLAY [KUBECTL-OPTIONS...]      e.g. --context prod
#
# First what all use, then one replica group after the other, then coordinators, then gateways; each is awaited. Run
# it again after a failure: what is up to date already is left alone. TIMEOUT (30m) is for each step.
set -euo pipefail

case "${1:-}" in
  "" | -h | --help)
    sed -n '2,/^set /p' "$0" | sed '$d; s/^# \{0,1\}//'
    [ -n "${1:-}" ] && exit 0 || exit 2
    ;;
esac
overlay="$1"
shift
kubectl=(kubectl "$@")
objects="$(kubectl kustomize "$overlay")"
namespace="$(sed -n '/^kind: Namespace/,/^---/s/^  name: //p' <<<"$objects")"

# The steps: labels, and the kind that is awaited. Each object of an overlay belongs to exactly one.
steps=(
  '!app.kubernetes.io/component'
  'app.kubernetes.io/component=partition job'
  'app.kubernetes.io/component=agent,!isoscope/replica-group'
  'app.kubernetes.io/component=agent,isoscope/replica-group=a statefulset'
  'app.kubernetes.io/component=agent,isoscope/replica-group=b statefulset'
  'app.kubernetes.io/component=coordinator deployment'
  'app.kubernetes.io/component=gateway deployment'
)
for step in "${steps[@]}"; do
  read -r labels kind <<<"$step"
  # Overlays may have no job and no second group.
  last="${labels##*,}"
  [[ "$last" == !* ]] || grep -qF "${last/=/: }" <<<"$objects" || continue
  echo "== $labels"
  "${kubectl[@]}" apply --kustomize "$overlay" --selector "$labels"
  case "$kind" in
    job) "${kubectl[@]}" --namespace "$namespace" wait --for=condition=complete --timeout "${TIMEOUT:-30m}" \
      job --selector "$labels" ;;
    ?*) "${kubectl[@]}" --namespace "$namespace" rollout status --timeout "${TIMEOUT:-30m}" "$kind" \
      --selector "$labels" ;;
  esac
done
