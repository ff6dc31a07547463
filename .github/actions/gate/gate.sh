# Measures, writes the job's summary and the output `verdict`. "Cannot tell" is a warning.
set -uo pipefail
read -ra options <<< "$OPTIONS"
if [ -n "$AGAINST" ]; then options+=(--against "$AGAINST"); fi
code=0
"$STLBENCH" gate "$REFERENCE" --budget "$BUDGET" --results "$RESULTS" ${options[@]+"${options[@]}"} || code=$?
case "$code" in
  0) verdict="no worse" ;;
  1) verdict="worse" ;;
  3) verdict="cannot tell"; echo "::warning::stlbench gate against $REFERENCE: cannot tell" ;;
  4) verdict="missing" ;;
  *) verdict="none" ;;
esac
echo "verdict=$verdict" >> "$GITHUB_OUTPUT"
if [ "$verdict" != none ] && [ -f "$RESULTS/gate.md" ]; then cat "$RESULTS/gate.md" >> "$GITHUB_STEP_SUMMARY"; fi
[ "$code" -eq 3 ] && code=0
exit "$code"
