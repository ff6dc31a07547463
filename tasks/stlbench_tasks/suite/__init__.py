"""A suite of formulas: systems x templates, regions and deadlines from a seed, feasible and not trivial."""

from stlbench_tasks.suite.formulas import FormulaSuite

__all__ = ["FormulaSuite"]
