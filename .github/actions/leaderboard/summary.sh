# Writes the tables of a leaderboard to the job's summary, and as comment.md for a pull request.
set -euo pipefail
LIMIT=60000 # characters; GitHub refuses comments of more than 65,536
if [ ! -f "$PAGE/table.md" ]; then echo "nothing to say: $PAGE/table.md is not there"; exit 0; fi
cat "$PAGE/table.md" >> "$GITHUB_STEP_SUMMARY"
{ echo "<!-- stlbench leaderboard -->"; cat "$PAGE/table.md"; } > "$PAGE/comment.md"
if [ "$(wc -c < "$PAGE/comment.md")" -gt "$LIMIT" ]; then
  printf '%s\n\n%s\n' "<!-- stlbench leaderboard -->" "The table is too long for a comment; the summary of the job has it." \
    > "$PAGE/comment.md"
fi
