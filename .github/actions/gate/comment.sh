# Writes comment.md as a comment on the pull request NUMBER, in place of the one that an earlier run wrote.
set -euo pipefail
if [ ! -f "$RESULTS/comment.md" ]; then echo "nothing to say: $RESULTS/comment.md is not there"; exit 0; fi
MARK=$(head -n 1 "$RESULTS/comment.md")
export MARK
comments="repos/$GITHUB_REPOSITORY/issues/$NUMBER/comments"
written=$(gh api --paginate "$comments" --jq '.[] | select(.body | startswith(env.MARK)) | .id')
written=${written%%$'\n'*}
if [ -n "$written" ]; then
  gh api --method PATCH "repos/$GITHUB_REPOSITORY/issues/comments/$written" --field "body=@$RESULTS/comment.md" > /dev/null
else
  gh api --method POST "$comments" --field "body=@$RESULTS/comment.md" > /dev/null
fi
