"""Everything that manages cells: the plan, one trial, the scheduler, the ledger, provenance."""
