"""How a plugin refuses what it cannot do. Import them from `stlbench.contract`."""


class Intractable(Exception):
    """A method would make training too dear; the message says what it would take. Ends a cell as `intractable`."""


class Unsuitable(ValueError):
    """A method or agent cannot be applied to this task, or on this machine; the message says which rule is broken."""
