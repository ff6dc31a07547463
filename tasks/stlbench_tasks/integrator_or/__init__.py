"""The paper's disjunction inside a temporal operator."""
