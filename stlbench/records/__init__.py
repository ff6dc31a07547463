"""All that a run leaves behind: ledger, rows, traces, policies, results and the identity of a cell."""
